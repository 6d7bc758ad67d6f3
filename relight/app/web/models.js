// The dialogue in which a matting model is chosen: a file, or one that rembg downloads.

import { h } from "../viewer.js";

export class ModelSheet {
  /** `onfile(file, options)` and `onname(name)`: what was chosen. */
  constructor(onfile, onname) {
    this.onname = onname;
    this.file = h("input", { type: "file", accept: ".onnx", hidden: true });
    this.file.addEventListener("change", () => {
      const [file] = this.file.files;
      this.file.value = "";
      if (file) onfile(file, this.options.value.trim());
    });
    this.options = h("input", {
      type: "text",
      class: "field",
      placeholder: "mean=0/0/0,std=1/1/1,size=320",
      spellcheck: "false",
    });
    this.sheet = h("dialog", { class: "sheet", "aria-label": "Find the person with a model" });
    this.sheet.addEventListener("click", (event) => event.target === this.sheet && this.sheet.close());
  }

  /** Asks whether the networks that find people may be fetched. */
  asks(about) {
    return new Promise((answer) => {
      const end = (value) => () => {
        answer(value);
        this.sheet.close();
      };
      this.sheet.addEventListener("close", end(false), { once: true });
      this.sheet.replaceChildren(
        h("h2", {}, "Find the person"),
        h(
          "p",
          {},
          `This needs ${about}. They are downloaded once, from the Python package index, and kept for all photographs.`,
        ),
        h(
          "div",
          { class: "choices" },
          h("button", { type: "button", class: "primary", onclick: end(true) }, "Fetch them"),
          h("button", { type: "button", class: "secondary", onclick: end(false) }, "Not now"),
        ),
      );
      this.sheet.showModal();
    });
  }

  /** `models`: [{ name, about }], which rembg offers. */
  open(models) {
    const choose = (name) => () => {
      this.sheet.close();
      this.onname(name);
    };
    this.sheet.replaceChildren(
      h(
        "form",
        { method: "dialog" },
        h("h2", {}, "Find the person with a model"),
        h("button", { class: "quiet" }, "Close"),
      ),
      h("p", {}, "A matting model outlines the person. You can correct the result."),
      h(
        "button",
        { type: "button", class: "secondary", onclick: () => (this.sheet.close(), this.file.click()) },
        "Open an ONNX file…",
      ),
      h("label", { class: "small" }, "Input options, if the file is of no known family:", this.options),
      models.length
        ? h(
            "p",
            { class: "small" },
            "Or rembg downloads one of these from the internet, once. Size and licence are those of the model:",
          )
        : h("p", { class: "small" }, "Install the extra matte of relight to download a model here."),
      h(
        "ul",
        { class: "files" },
        ...models.map(({ name, about }) =>
          h(
            "li",
            {},
            h("button", { type: "button", class: "quiet", onclick: choose(name) }, h("b", {}, name), ` ${about}`),
          ),
        ),
      ),
    );
    this.sheet.showModal();
  }
}
