// The lighting plot as a sheet: looked at, printed, or saved. The server draws it.

import { h } from "../viewer.js";
import { post } from "./requests.js";

export class Plot {
  /** `app`: shows progress, and says what went wrong; `look()`: the light as the server takes it. */
  constructor(app, look) {
    this.app = app;
    this.look = look;
    this.element = h("button", { type: "button", onclick: () => this.open() }, "Lighting plot");
    this.drawing = h("img", { alt: "Lighting plot: the lights from above and from the side, and a table of them" });
    this.file = h("a", { class: "secondary", download: "lighting-plot.svg" }, "Save SVG");
    const button = (label, onclick, kind) => h("button", { type: "button", class: kind, onclick }, label);
    const actions = h("div", { class: "actions" });
    actions.append(
      button("Print", () => print(), "primary"),
      this.file,
      button("Close", () => this.sheet.close(), "secondary"),
    );
    this.sheet = h("dialog", { class: "sheet plot", "aria-label": "Lighting plot" }, this.drawing, actions);
    this.sheet.addEventListener("close", () => URL.revokeObjectURL(this.drawing.src));
    app.root.append(this.sheet);
  }

  /** Draws the lights as they are now. */
  async open() {
    const { app } = this;
    await app.busy(async (say, signal) => {
      say("Drawing the plot");
      const response = await post(`photographs/${app.chosen.id}/plot`, this.look(), signal);
      this.drawing.src = this.file.href = URL.createObjectURL(await response.blob());
      await this.drawing.decode();
      this.sheet.showModal();
    });
  }
}
