// The light of the background, or of another photograph, in place of the lights.

import { checkedLight, h } from "../viewer.js";
import { askJson, follow } from "./requests.js";

export class Match {
  /** `look()`: the light as the server takes it. */
  constructor(app, look) {
    this.app = app;
    this.look = look;
    this.viewer = null;
    this.input = h("input", { type: "file", hidden: true, "aria-label": "A photograph whose light is matched" });
    this.input.addEventListener("change", () => {
      const [file] = this.input.files;
      this.input.value = "";
      if (file) this.matchFile(file);
    });
    const button = (label, title, onclick) => h("button", { type: "button", title, onclick }, label);
    this.behind = button("Match background", "Light the person as the place behind them is lit", () =>
      this.match(null),
    );
    this.element = h(
      "div",
      { class: "match", role: "group", "aria-label": "Match the light" },
      this.behind,
      button("Match a photograph…", "Light the person as the person in another photograph is lit", () =>
        this.input.click(),
      ),
      this.input,
    );
  }

  attach(viewer, photograph) {
    this.viewer = viewer;
    this.photograph = photograph;
    const follows = () => (this.behind.disabled = typeof viewer.state.background !== "string");
    viewer.listeners.add(follows);
    follows();
  }

  async matchFile(file) {
    await this.app.busy(async (say, signal) => {
      say(`Reading ${file.name}`);
      const kept = await askJson(`references?name=${encodeURIComponent(file.name)}`, { body: file, signal });
      await this.match(kept.file);
    });
  }

  /** `file`: the other photograph's id; null for the background. */
  async match(file) {
    const { viewer, photograph } = this;
    await this.app.busy(async (say, signal) => {
      say("Matching the light");
      const asked = { look: this.look(viewer), file };
      const { lights, notes } = await follow(`photographs/${photograph.id}/match`, asked, say, signal);
      viewer.stop();
      viewer.change((state) => {
        Object.assign(state, { lights: lights.map((light) => checkedLight(light)), selected: 0, fill: 0, amount: 1 });
        if (state.environment) state.environment.muted = true;
      });
      if (notes.length) this.app.tell(notes.join(" "));
    });
  }
}
