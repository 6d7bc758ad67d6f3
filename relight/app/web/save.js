// The last step: files at full resolution, and the command and the Python lines that make the same picture.

import { h, toCommand } from "../viewer.js";
import { follow } from "./requests.js";

const FORMATS = [
  [".png", "PNG", "The picture, transparent where there is no background"],
  [".jpg", "JPEG", "The picture over its background, to send"],
  [".webp", "WebP", "A small file for the web, transparent where there is no background"],
  [".tif", "TIFF", "The picture in 16 bits, for retouching"],
  [".exr", "OpenEXR", "For compositing: scene-linear, with a layer for each light"],
  [".html", "Page", "One file in which anyone can drag the lights"],
  [".mp4", "Movie", "The whole clip in this light, H.264, to look at"],
  [".mov", "ProRes movie", "The whole clip in this light, for further work"],
  [".glb", "3D model", "The person as a mesh, for 3D programs"],
];
const MOVIES = [".mp4", ".mov"];
const SIZED = [".png", ".jpg", ".webp", ".tif"]; // pictures that can be reduced
const LOSSY = [".jpg", ".webp"];
const SIDES = [4096, 2048, 1080]; // pixels
const QUALITY = 98; // of the files unless it is chosen
const PASSES = [
  ["albedo", "Albedo"],
  ["N", "Normals"],
  ["Z", "Depth"],
  ["visibility", "Visibility"],
  ["shading", "Shading"],
];

export class Save {
  constructor(app) {
    this.app = app;
    this.preview = h("canvas", { class: "result", role: "img", "aria-label": "The picture" });
    this.passes = PASSES.map(([name, label]) => {
      const box = h("input", { type: "checkbox", value: name });
      return { box, element: h("label", {}, box, label) };
    });
    this.plate = h("input", { type: "checkbox" });
    this.plateLabel = h("label", {}, this.plate, "The photograph's background, as it is shown");
    this.format = ".png"; // that the command and the lines of Python write
    this.side = h(
      "select",
      { "aria-label": "Size of pictures", class: "field" },
      h("option", { value: "" }, "Full resolution"),
      ...SIDES.map((side) => h("option", { value: side }, `${side} pixels`)),
    );
    this.side.addEventListener("change", () => this.refresh());
    this.qualities = Object.fromEntries(LOSSY.map((suffix) => [suffix, this.quality()]));
    this.rows = Object.fromEntries(FORMATS.map((format) => [format[0], this.row(...format)]));
    this.saveMatte = h("a", { class: "secondary", download: "" }, "Save the matte");
    this.saveTurned = h("a", { class: "secondary", download: "" }, "Save the turned photograph");
    this.renamed = h("p", { class: "hint" });
    this.command = this.code("Command line");
    this.python = this.code("Python");
    this.element = h(
      "section",
      { class: "save", "aria-label": "Save files" },
      h("div", { class: "shown" }, this.preview),
      h(
        "div",
        { class: "options" },
        h("h2", {}, "Save files"),
        h("label", { class: "hint side" }, "Longer side of pictures", this.side),
        h("ul", { class: "formats" }, ...Object.values(this.rows).map(({ element }) => element)),
        h("h2", {}, "Make it again"),
        h(
          "p",
          { class: "hint" },
          "The command and the lines of Python make the same picture, pixel for pixel. Both need the photograph and its matte beside it, or the movie.",
        ),
        this.saveTurned,
        this.saveMatte,
        this.renamed,
        this.command.element,
        this.python.element,
      ),
    );
  }

  row(suffix, name, about) {
    const button = h(
      "button",
      { type: "button", class: "secondary", "aria-label": `Save ${name}`, onclick: () => this.save(suffix) },
      "Save",
    );
    const extra =
      suffix === ".exr"
        ? [
            h(
              "div",
              { class: "passes", role: "group", "aria-label": "Further layers" },
              ...this.passes.map(({ element }) => element),
              this.plateLabel,
            ),
          ]
        : [];
    if (LOSSY.includes(suffix)) extra.push(h("label", { class: "quality hint" }, "Quality", this.qualities[suffix]));
    const detail = h("span", { class: "hint" }, about);
    return {
      button,
      detail,
      about,
      element: h("li", { "data-suffix": suffix }, h("div", {}, h("b", {}, name), detail, ...extra), button),
    };
  }

  /** A field for the quality of files that lose something. */
  quality() {
    const field = h("input", { type: "number", min: 1, max: 100, value: QUALITY });
    field.addEventListener("change", () => {
      field.value = Math.min(100, Math.max(1, Math.round(Number(field.value)) || QUALITY));
      this.refresh();
    });
    return field;
  }

  /** What a format's files are like, as `relight.Output` has it: what is not as it is unless it is chosen. */
  form(suffix) {
    const quality = LOSSY.includes(suffix) ? Number(this.qualities[suffix].value) : QUALITY;
    return {
      ...(quality !== QUALITY && { quality }),
      ...(SIZED.includes(suffix) && this.side.value && { longest_side: Number(this.side.value) }),
    };
  }

  /** A command or program, with a button that copies it. */
  code(label) {
    const text = h("pre", { tabindex: 0, "aria-label": label });
    const copy = h(
      "button",
      { type: "button", class: "quiet", "aria-label": `Copy: ${label}`, onclick: () => this.copy(text.textContent) },
      "Copy",
    );
    return { text, element: h("div", { class: "code" }, h("h3", {}, label, copy), text) };
  }

  async copy(text) {
    try {
      await navigator.clipboard.writeText(text);
      this.app.tell("Copied.");
    } catch {
      this.app.tell("The browser does not let the page copy: select the text, and copy it by hand.", true);
    }
  }

  focus() {
    this.rows[".png"].button.focus({ preventScroll: true });
  }

  open() {
    this.snapshot(this.app.parts.light.viewer);
    this.format = ".png";
    this.refresh();
  }

  refresh() {
    const { chosen, parts } = this.app;
    const { viewer } = parts.light;
    const look = parts.light.look();
    this.plateLabel.hidden = look.background !== "original";
    this.rows[".jpg"].button.disabled = !look.background;
    this.rows[".jpg"].detail.textContent = look.background
      ? this.rows[".jpg"].about
      : "Needs a background: choose a colour or a picture in the light step";
    for (const [suffix, { element }] of Object.entries(this.rows))
      element.hidden = !this.app.about.outputs.includes(suffix) || (MOVIES.includes(suffix) && !chosen.movie);
    this.rows[".mp4"].button.disabled = !look.background;
    this.rows[".mp4"].detail.textContent = look.background
      ? this.rows[".mp4"].about
      : "Needs a background: an .mp4 has no transparency";
    const fileOf = (name) => `photographs/${chosen.id}/files/${encodeURIComponent(name)}`;
    this.saveMatte.hidden = !chosen.mask;
    if (chosen.mask) this.saveMatte.href = fileOf(chosen.mask);
    this.saveTurned.hidden = !chosen.turns;
    if (chosen.turns) this.saveTurned.href = fileOf(chosen.name);
    const output = chosen.movie ? `${stemOf(chosen.movie)}-relit.mp4` : `${stemOf(chosen.name)}-relit${this.format}`;
    const form = chosen.movie ? {} : this.form(this.format);
    const behind = backgroundName(viewer, chosen);
    this.renamed.hidden = !behind || behind === viewer.backdrop.name;
    this.renamed.textContent = `They name the background ${behind}: ${viewer.backdrop?.name} is the name of another file.`;
    const backdrop = viewer.backdrop && { ...viewer.backdrop, name: behind };
    const options = Object.entries(form).map(([key, value]) => ` --${key.replace("_", "-")} ${value}`);
    const command = toCommand(viewer.state, viewer.environment, viewer.scene, backdrop, output) + options.join("");
    // A browser would break lines within "--light".
    const words = command.split(/(?<= )/).map((word) => (word.startsWith("-") ? h("span", {}, word) : word));
    this.command.text.replaceChildren(...words);
    this.python.text.textContent = toPython(look, chosen, viewer, output, behind, form);
  }

  /** The picture as the light step shows it. */
  snapshot(viewer) {
    const { preview } = this;
    viewer.redraw();
    const { canvas } = viewer.stage;
    const { width, height } = canvas;
    const shrink = Math.min(1, 1600 / Math.max(width, height, 1));
    [preview.width, preview.height] = [
      Math.max(1, Math.round(width * shrink)),
      Math.max(1, Math.round(height * shrink)),
    ];
    preview.getContext("2d").drawImage(canvas, 0, 0, preview.width, preview.height);
  }

  async save(suffix) {
    const { chosen, parts } = this.app;
    await this.app.busy(async (say, signal) => {
      say("Making the picture", 0);
      const passes = this.passes.filter(({ box }) => box.checked).map(({ box }) => box.value);
      const { file, notes } = await follow(
        `photographs/${chosen.id}/save`,
        { suffix, passes, look: parts.light.look(), plate: this.plate.checked, ...this.form(suffix) },
        say,
        signal,
      );
      const link = h("a", { href: `photographs/${chosen.id}/files/${encodeURIComponent(file)}`, download: file });
      link.click();
      if (SIZED.includes(suffix) && this.app.step === "save") {
        this.format = suffix; // the command makes the file that was saved
        this.refresh();
      }
      this.app.tell([`Saved ${file}.`, ...notes].join(" "));
    });
  }
}

const stemOf = (name) => name.replace(/\.\w+$/, "");

/**
 * The background's file as the command names it: with a number where the photograph, its matte or the result has its
 * name.
 */
function backgroundName({ state, backdrop }, photograph) {
  if (!backdrop || state.background === "original") return backdrop?.name;
  const [stem, own] = [stemOf(backdrop.name), stemOf(photograph.name)];
  const taken = backdrop.name === photograph.name || stem === `${own}-matte` || stem === `${own}-relit`;
  return taken ? `${stem}-2${backdrop.name.slice(stem.length)}` : backdrop.name;
}

/** Lines of Python that make the same picture. */
function toPython(look, photograph, viewer, output, behind, form) {
  const text = (value) => JSON.stringify(value);
  const lights = look.lights.map((light) => `        ${text(light)},`);
  const environment = look.environment && text(`${viewer.environment.path},${look.environment.settings}`);
  const { background } = look;
  const { command } = viewer.scene;
  const after = (word) => command.includes(word) && command[command.indexOf(word) + 1];
  const feather = after("--feather");
  const { scale, offset } = look.placement ?? {};
  const where = look.placement ? `, scale=${scale}, offset=(${offset.join(", ")})` : "";
  const source = photograph.movie
    ? `${text(photograph.movie)}, person=(${after("--person").replace("/", ", ")})`
    : `${text(photograph.name)}${photograph.mask ? `, mask=${text(photograph.mask)}` : ""}${feather ? `, feather=${feather}` : ""}${where}`;
  const written = { ...(Number(look.exposure) && { exposure: look.exposure }), ...form };
  const options = Object.entries(written).map(([key, value]) => `, ${key}=${value}`);
  return [
    "import relight",
    "",
    "relight.render_shot(",
    `    relight.Source(${source}),`,
    "    relight.Lighting(",
    ...(lights.length ? ["        light=[", ...lights.map((line) => `    ${line}`), "        ],"] : []),
    ...(environment ? [`        environment=[${environment}],`] : []),
    ...(background && background !== "original"
      ? [`        background=${Array.isArray(background) ? `(${background.join(", ")})` : text(behind)},`]
      : []),
    ...(!background && viewer.original ? ['        background="none",'] : []),
    ...(look.floor ? [`        floor=relight.Floor(${look.floor}),`] : []),
    ...(Number(look.fill) ? ['        fill="background",', `        fill_amount=${look.fill},`] : []),
    ...(Number(look.blur) ? [`        background_blur=${look.blur},`] : []),
    ...(Number(look.backgroundLight) ? [`        background_light=${look.backgroundLight},`] : []),
    ...(Number(look.gloss) ? [`        gloss=${look.gloss},`] : []),
    ...(Number(look.amount) < 1 ? [`        amount=${look.amount},`] : []),
    "    ),",
    `    ${options.length ? `relight.Output(${text(output)}${options.join("")})` : text(output)},`,
    ")",
  ].join("\n");
}
