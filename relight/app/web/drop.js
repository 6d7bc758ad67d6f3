// The first step: a photograph comes in, by dropping, pasting or choosing it.

import { h } from "../viewer.js";

const WHERE = ["127.0.0.1", "localhost"].includes(location.hostname)
  ? "Nothing leaves this computer."
  : "Photographs go to the computer that serves this page, and no further; the connection is not encrypted.";

export class Drop {
  constructor(app) {
    this.app = app;
    this.input = h("input", { type: "file", multiple: true, hidden: true });
    this.input.addEventListener("change", () => {
      const files = [...this.input.files];
      this.input.value = "";
      if (files.length) app.add(files);
    });
    this.choose = h(
      "button",
      { type: "button", class: "primary", onclick: () => this.input.click() },
      "Choose photographs…",
    );
    this.about = h("p");
    this.finder = offer("Fetch them once", () => app.fetchFinder());
    this.silhouette = offer("Fetch it once", () => app.fetchSilhouette());
    this.files = h("ul", { class: "files" });
    this.folder = h(
      "section",
      { class: "folder", "aria-label": "Files of the folder", hidden: true },
      h("h2", {}, "Or choose from the folder"),
      this.files,
    );
    this.element = h(
      "section",
      { class: "drop", "aria-label": "Photograph" },
      h(
        "div",
        { class: "target" },
        h("h2", {}, "Drop a photograph of a person"),
        this.about,
        h(
          "div",
          { class: "choices" },
          this.choose,
          h(
            "button",
            { type: "button", class: "secondary", onclick: () => app.addFrom("example", {}) },
            "Try the example",
          ),
        ),
        h(
          "p",
          { class: "small" },
          "JPEG, PNG, HEIC, raw, EXR or TIFF, up to 100 megapixels, or a movie: its first frame with a person is lit. Pasting works too.",
        ),
        this.input,
        this.finder.element,
        this.silhouette.element,
      ),
      this.folder,
    );
  }

  focus() {
    this.choose.focus({ preventScroll: true });
  }

  refresh() {
    const { root, finder, finder_about, silhouette, silhouette_about } = this.app.about;
    this.about.textContent = `${finder === "ready" ? "The person is found, and you drag the lights." : "Then outline the person and drag the lights."} ${WHERE}`;
    this.finder.element.hidden = finder !== "fetch";
    this.finder.about.textContent = `People can be found for you, by ${finder_about}.`;
    this.silhouette.element.hidden = finder !== "ready" || silhouette !== "fetch";
    this.silhouette.about.textContent = `Hair, hands and what people hold are kept by ${silhouette_about}.`;
    this.folder.hidden = !root.length;
    this.files.replaceChildren(
      ...root.map(({ path, name }) =>
        h(
          "li",
          {},
          h("button", { type: "button", class: "quiet", onclick: () => this.app.addFrom("root", { path }) }, name),
        ),
      ),
    );
  }
}

/** A line that says what can be fetched, with the button that does it; its words go to `about`. */
function offer(label, fetches) {
  const about = h("span");
  const button = h("button", { type: "button", class: "secondary", onclick: fetches }, label);
  return { element: h("p", { class: "finder small" }, about, button), about };
}
