// Where a page begins, and the widget of a notebook.

import { h } from "./dom.js";
import { Unsupported } from "./gl.js";
import { fromBase64 } from "./pack.js";
import { checkedLight, shining, toCommand, toFragment, toYaml } from "./state.js";
import { Viewer } from "./viewer.js";

/** Says in place of a picture why there is none. */
function explain(root, error) {
  const known = error instanceof Unsupported;
  root.replaceChildren(h("p", { class: "sorry", role: "alert" }, known ? error.message : `The page cannot be shown: ${error.message}`));
}

/** The page: its data lies in script elements. */
export async function openPage(page) {
  const root = page.getElementById("viewer");
  try {
    const scene = JSON.parse(page.getElementById("scene").textContent);
    const viewer = await Viewer.open(root, scene, fromBase64(page.getElementById("pack").textContent), true);
    window.relight = api(viewer);
    window.dispatchEvent(new Event("relight")); // for a program whose frame the page is in
  } catch (error) {
    explain(root, error);
    if (!(error instanceof Unsupported)) throw error;
  }
}

/** What programs may do with a page. */
const api = (viewer) => ({
  render: (lights) => viewer.render(lights),
  lights: () => toYaml(viewer.state, viewer.environment),
  link: () => toFragment(viewer.state),
  command: () => toCommand(viewer.state, viewer.environment, viewer.scene, viewer.backdrop?.name),
  viewer,
});

/** The widget of a notebook (anywidget): its lights are those that shine, in Python and here. */
export async function render({ model, el }) {
  const root = h("div", { class: "relight embedded" });
  el.append(root);
  try {
    const view = model.get("pack");
    const viewer = await Viewer.open(root, model.get("scene"), new Uint8Array(view.buffer, view.byteOffset, view.byteLength), false);
    const plain = (state) => shining(state).map(({ muted, solo, ...light }) => light);
    let told = JSON.stringify(plain(viewer.state));
    viewer.listeners.add((state) => {
      const lights = plain(state);
      if (JSON.stringify(lights) === told) return;
      told = JSON.stringify(lights);
      model.set("lights", lights);
      model.save_changes();
    });
    model.on("change:lights", () => {
      const lights = model.get("lights").map((light) => checkedLight(light));
      if (JSON.stringify(lights.map(({ muted, solo, ...light }) => light)) === told) return;
      viewer.change((state) => Object.assign(state, { lights, selected: Math.max(0, Math.min(state.selected, lights.length - 1)) }));
    });
    return () => viewer.stop();
  } catch (error) {
    explain(root, error);
  }
}
