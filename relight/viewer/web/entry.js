// Where a page begins, and the widget of a notebook.

import { h } from "./dom.js";
import { LIGHTS } from "./engine.js";
import { Unsupported } from "./gl.js";
import { isNear } from "./lights.js";
import { fromBase64 } from "./pack.js";
import { checkedLight, shining, toCommand, toFragment, toYaml } from "./state.js";
import { Viewer } from "./viewer.js";

/** Says in place of a picture why there is none. */
function explain(root, error) {
  const known = error instanceof Unsupported;
  root.replaceChildren(
    h("p", { class: "sorry", role: "alert" }, known ? error.message : `The page cannot be shown: ${error.message}`),
  );
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
  render: (lights, gloss, amount) => viewer.render(lights, gloss, amount),
  lights: () => toYaml(viewer.state, viewer.environment),
  link: () => toFragment(viewer.state),
  command: () => toCommand(viewer.state, viewer.environment, viewer.scene, viewer.backdrop),
  viewer,
});

/** A light as Python sends it, see `parameters_of` in relight/viewer/scene.py. */
function asInPython({ muted, solo, ...light }) {
  const rounded = (degrees) => Math.round(degrees * 1e4) / 1e4;
  return isNear(light) ? light : { ...light, azimuth: rounded(light.azimuth), elevation: rounded(light.elevation) };
}

/**
 * The lights of the panel with Python's in place of those that shine; those that do not shine stay, as far as there
 * is room.
 */
function merged(lights, active, given) {
  const alone = lights.some((light) => light.solo);
  const next = given.map((light) => ({ ...light, solo: alone }));
  const dark = lights.length - active.length;
  if (alone && !given.length)
    return lights.filter((light) => !active.includes(light)).map((light) => ({ ...light, muted: true }));
  if (given.length + dark > LIGHTS) return next;
  return [...lights.flatMap((light) => (active.includes(light) ? next.splice(0, 1) : [light])), ...next];
}

/** The widget of a notebook (anywidget): its lights, gloss and amount are those of Python and of the page. */
export async function render({ model, el }) {
  const root = h("div", { class: "relight embedded" });
  el.append(root);
  try {
    const view = model.get("pack");
    const viewer = await Viewer.open(
      root,
      model.get("scene"),
      new Uint8Array(view.buffer, view.byteOffset, view.byteLength),
      false,
    );
    const plain = (state) => shining(state).map(asInPython);
    let told = JSON.stringify(plain(viewer.state));
    viewer.listeners.add((state) => {
      const lights = plain(state);
      const same = JSON.stringify(lights) === told;
      if (same && state.gloss === model.get("gloss") && state.amount === model.get("amount")) return;
      if (!same) {
        told = JSON.stringify(lights);
        model.set("lights", lights);
      }
      model.set("gloss", state.gloss);
      model.set("amount", state.amount);
      model.save_changes();
    });
    for (const name of ["gloss", "amount"])
      model.on(`change:${name}`, () => viewer.change((state) => (state[name] = model.get(name))));
    model.on("change:lights", () => {
      const lights = model.get("lights").map((light) => checkedLight(light));
      if (JSON.stringify(lights.map(asInPython)) === told) return;
      viewer.stop();
      viewer.change((state) => {
        state.lights = merged(state.lights, shining(state), lights);
        state.selected = Math.max(0, Math.min(state.selected, state.lights.length - 1));
      });
    });
    return () => viewer.stop();
  } catch (error) {
    explain(root, error);
  }
}
