// The second step: a line around the person, and strokes that correct what it found.
//
// Places are shares of the photograph's width and height. The server solves the matte; this file draws.

import { h, iconButton, wheeled } from "../viewer.js";
import { ModelSheet } from "./models.js";
import { Paper, veilOf } from "./paper.js";
import { People } from "./people.js";
import { ask, askJson, follow, notesOf, post, previewOf } from "./requests.js";

const CLOSE = 14; // CSS pixels from a line's first corner, within which it closes
const DOUBLE_CLICK = 500; // milliseconds between its clicks, at most
const DRAG = 5; // CSS pixels of motion that make a press a stroke
const APART = 3; // CSS pixels between the points of a freehand line
const STEP = 0.01; // of the picture, that an arrow key moves the pen
const NOTHING = { lasso: null, strokes: [], holes: [], model: false, shift: 0, feather: 0 }; // drawn yet
const EDGE = 0.01; // of the photograph's longer side, at the ends of the sliders that shift and blur the edge
const TOOLS = [
  ["lasso", "Outline", "Draw a line around the person: drag, or click corner by corner"],
  ["person", "Person", "Paint what belongs to the person"],
  ["background", "Background", "Paint what does not belong to the person"],
  ["hole", "Cut out", "Draw a line around what does not belong to the person, such as a gap between arm and body"],
];

export class OutlineStep {
  constructor(app) {
    this.app = app;
    this.closedAt = -DOUBLE_CLICK; // when a line was closed
    this.drawings = new Map(); // photograph id: { now, past, future }, drawings like NOTHING
    this.canvas = h("canvas", {
      tabindex: 0,
      role: "application",
      "aria-label":
        "The photograph. Drag to draw around the person. With the keyboard: arrows move the pen, Enter sets a corner, C closes the line.",
    });
    this.paper = new Paper(this.canvas);
    this.hint = h("p", { class: "hint", "aria-live": "polite" });
    this.stage = h("div", { class: "paper" }, this.canvas, this.hint);
    this.buttons = Object.fromEntries(
      TOOLS.map(([name, label, title]) => [
        name,
        h("button", { type: "button", class: "tool", title, onclick: () => this.use(name) }, label),
      ]),
    );
    this.people = new People(
      (person) => this.take(person),
      () => this.use("people"),
    );
    this.buttons.people = this.people.tool;
    this.turnButton = h(
      "button",
      { type: "button", class: "tool", title: "Turn the photograph by 90° (R)", onclick: () => this.app.turn() },
      "Turn",
    );
    this.size = h("input", { type: "range", min: 1, max: 100, value: 30, "aria-label": "Brush size" });
    this.size.addEventListener("input", () => this.draw());
    this.shift = this.edge("shift", "Shift", -100);
    this.feather = this.edge("feather", "Feather", 0);
    this.greyButton = h(
      "button",
      {
        type: "button",
        class: "tool",
        title: "Show the matte alone: white is the person (M)",
        "aria-pressed": "false",
        onclick: () => this.showGrey(!this.grey),
      },
      "Matte",
    );
    this.file = h("input", { type: "file", accept: "image/*,.exr,.tif,.tiff", hidden: true, "aria-label": "A matte" });
    this.file.addEventListener("change", () => {
      const [file] = this.file.files;
      this.file.value = "";
      if (file) this.app.trying(() => this.load(file));
    });
    this.undoButton = iconButton("undo", "Undo", () => this.undo(), "Ctrl Z");
    this.redoButton = iconButton("redo", "Redo", () => this.redo(), "Ctrl Shift Z");
    this.models = new ModelSheet(
      (file, options) => this.findByFile(file, options),
      (name) => this.find({ name }),
    );
    this.finder = h("button", { type: "button", class: "tool", onclick: () => this.findPerson() }, "Find the person");
    this.accept = h(
      "button",
      { type: "button", class: "primary", onclick: () => this.app.analyse(this.plain()) },
      "Use this outline",
    );
    this.element = h(
      "section",
      { class: "outline", "aria-label": "Outline" },
      this.stage,
      h(
        "div",
        { class: "tools" },
        h("div", { class: "group", role: "group", "aria-label": "Tool" }, ...TOOLS.map(([name]) => this.buttons[name])),
        this.people.element,
        h("label", { class: "brush" }, h("span", {}, "Brush"), this.size),
        h("div", { class: "edge", role: "group", "aria-label": "Edge" }, this.shift.element, this.feather.element),
        this.greyButton,
        h("div", { class: "group" }, this.undoButton, this.redoButton),
        h(
          "div",
          { class: "group zooms" },
          h("button", { type: "button", class: "tool", "aria-label": "Zoom out", onclick: () => this.zoom(0.7) }, "−"),
          h(
            "button",
            { type: "button", class: "tool", title: "Show all of the photograph (0)", onclick: () => this.fit() },
            "Show all",
          ),
          h("button", { type: "button", class: "tool", "aria-label": "Zoom in", onclick: () => this.zoom(1.4) }, "+"),
        ),
        this.turnButton,
        this.finder,
        h(
          "button",
          { type: "button", class: "tool", onclick: () => this.models.open(this.app.about.models) },
          "Find with a model…",
        ),
        h(
          "button",
          {
            type: "button",
            class: "tool",
            title: "Take a matte from a picture: white is the person",
            onclick: () => this.file.click(),
          },
          "Load a matte…",
        ),
        this.file,
        this.models.file,
        this.models.sheet,
        this.accept,
      ),
    );
    this.pointers = new Map();
    this.listen();
  }

  /** A slider that shifts or blurs the edge; a double click on its name takes that back. */
  edge(name, label, least) {
    const input = h("input", { type: "range", min: least, max: 100, value: 0, "aria-label": `${label} the edge` });
    const shown = h("output", {}, "0 px");
    const set = (value) => {
      const share = (value / 100) * EDGE;
      if (share !== this.drawing[name]) this.change({ ...this.drawing, [name]: share });
    };
    input.addEventListener("change", () => set(Number(input.value)));
    input.addEventListener("input", () => (shown.textContent = this.pixels((Number(input.value) / 100) * EDGE)));
    const element = h("label", { class: "brush" }, h("span", { ondblclick: () => set(0) }, label), input, shown);
    return { element, input, shown, name };
  }

  /** A share of the photograph's longer side, in its pixels. */
  pixels(share) {
    const side = Math.max(this.photograph.width, this.photograph.height);
    return `${(share * side).toFixed(1)} px`;
  }

  listen() {
    const on = (name, listener, options) => this.canvas.addEventListener(name, listener, options);
    on("pointerdown", (event) => this.down(event));
    on("pointermove", (event) => this.move(event));
    for (const name of ["pointerup", "pointercancel"]) on(name, (event) => this.up(event));
    on("pointerleave", () => ((this.pen = null), this.draw()));
    on("contextmenu", (event) => event.preventDefault());
    on("dblclick", () => this.close());
    on(
      "wheel",
      (event) => {
        event.preventDefault();
        this.zoom(wheeled(event), this.paper.at(event));
      },
      { passive: false },
    );
    this.element.addEventListener("keydown", (event) => this.key(event));
    new ResizeObserver(() => this.canvas.clientWidth && this.fit()).observe(this.stage);
  }

  // --- opening

  async open() {
    const { chosen } = this.app;
    if (this.photograph !== chosen || !this.image) {
      this.photograph = chosen;
      this.paper.image = this.matte = this.greys = null;
      this.corners = [];
      const picture = new Image();
      picture.src = previewOf(chosen);
      await picture.decode();
      if (this.photograph !== chosen) return; // another one has been chosen meanwhile
      this.paper.image = picture;
    }
    if (!this.drawings.has(chosen.id))
      // another tab may have drawn one that was analysed
      this.drawings.set(chosen.id, { now: { ...NOTHING, ...chosen.drawn }, past: [], future: [] });
    this.finder.hidden = !this.app.about.finder;
    this.turnButton.hidden = Boolean(chosen.movie);
    this.people.show(chosen.people);
    if (this.people.several && !this.drawing.strokes.length) this.use("people");
    else this.use(this.drawing.lasso || chosen.cut_out || this.drawing.model ? "person" : "lasso");
    this.fit();
    if (!this.matte && (this.drawn || chosen.cut_out)) await this.solve();
  }

  /** The photograph has been turned: what was drawn on it is of no use. */
  forget(photograph) {
    this.drawings.delete(photograph.id);
    if (this.photograph !== photograph) return;
    clearTimeout(this.waiting);
    this.solving?.abort();
    this.paper.image = null;
  }

  /** Begins with a matte that the server has found of a photograph: the drawing that means it. */
  foundByModel(photograph, model) {
    const kept = this.drawings.get(photograph.id);
    const now = { ...NOTHING, model };
    this.drawings.set(photograph.id, { now, past: kept ? [...kept.past, kept.now] : [], future: [] });
    if (this.photograph === photograph) this.matte = null;
    return now;
  }

  /** Where messages are shown. */
  noticePlace() {
    return this.stage;
  }

  focus() {
    this.canvas.classList.add("by-hand");
    this.canvas.focus({ preventScroll: true });
  }

  get image() {
    return this.paper.image;
  }

  get drawing() {
    return this.drawings.get(this.photograph.id).now;
  }

  /** Whether there is anything to make a matte of. */
  get drawn() {
    const { lasso, strokes, holes, model, shift, feather } = this.drawing;
    return Boolean(lasso || strokes.length || model || (this.photograph.cut_out && (holes.length || shift || feather)));
  }

  /** The drawing as the server takes it; null where the photograph's own alpha stands as it is. */
  plain() {
    return this.drawn ? this.drawing : null;
  }

  change(next) {
    const kept = this.drawings.get(this.photograph.id);
    kept.past.push(kept.now);
    kept.future = [];
    kept.now = next;
    this.changed();
  }

  undo() {
    if (this.corners.length) {
      this.corners.pop();
      this.draw();
      return;
    }
    this.turn("past", "future");
  }

  redo() {
    this.turn("future", "past");
  }

  turn(from, to) {
    const kept = this.drawings.get(this.photograph.id);
    if (!kept[from].length) return;
    kept[to].push(kept.now);
    kept.now = kept[from].pop();
    this.changed();
  }

  changed() {
    if (!this.drawn && !this.photograph.cut_out) this.matte = null;
    this.draw();
    clearTimeout(this.waiting);
    this.waiting = setTimeout(() => this.app.trying(() => this.solve()), 120);
  }

  /** Has the server solve the matte of what is drawn; an older answer never follows a newer one. */
  async solve() {
    const { photograph } = this;
    this.solving?.abort();
    if (!this.drawn && !photograph.cut_out) return;
    const solving = (this.solving = new AbortController());
    this.draw();
    try {
      await this.shows(await post(`photographs/${photograph.id}/outline`, this.drawing, solving.signal), photograph);
    } catch (error) {
      if (error.name !== "AbortError") {
        this.matte = null;
        throw error;
      }
    } finally {
      if (this.solving === solving) {
        this.solving = null;
        this.draw();
      }
    }
  }

  /** Shows the matte that a response holds: what is not the person is dimmed. */
  async shows(response, photograph) {
    const bitmap = await createImageBitmap(await response.blob());
    if (photograph !== this.photograph) return;
    [this.matte, this.greys] = [veilOf(bitmap), bitmap];
    const notes = notesOf(response);
    if (notes.length) this.app.tell(notes.join(" "));
  }

  // --- another's matte

  /** Begins with a matte from a file. */
  async load(file) {
    const { photograph } = this;
    const response = await ask(`photographs/${photograph.id}/matte?name=${encodeURIComponent(file.name)}`, {
      body: file,
    });
    await this.shows(response, photograph);
    this.change({ ...NOTHING, model: "file" });
    this.use("person");
  }

  /** Shows the matte alone, in black and white, or the photograph. */
  showGrey(grey) {
    this.grey = grey;
    this.greyButton.setAttribute("aria-pressed", String(grey));
    this.draw();
  }

  async findByFile(file, options) {
    await this.app.trying(async () => {
      const kept = await askJson(`models?name=${encodeURIComponent(file.name)}`, { body: file });
      await this.find({ file: kept.file, options });
    });
  }

  /** Finds the person again, after asking for the networks where they are missing, and opens the light. */
  async findPerson() {
    const { app, photograph } = this;
    if (app.about.finder === "fetch" && !(await this.models.asks(app.about.finder_about))) return;
    if (app.about.finder === "fetch" && !(await app.fetchFinder())) return;
    await app.findPerson(photograph);
  }

  /** Begins with the matte of another person, or of everybody. */
  async take(person) {
    const { photograph } = this;
    await this.app.busy(async (say, signal) => {
      say("Finding the person");
      const { model, notes } = await follow(`photographs/${photograph.id}/person`, { person }, say, signal);
      this.change({ ...NOTHING, model });
      if (notes.length) this.app.tell(notes.join(" "));
    });
  }

  async find(model) {
    const { photograph } = this;
    await this.app.busy(async (say, signal) => {
      say("Finding the person");
      const response = await ask(`photographs/${photograph.id}/model`, { body: JSON.stringify(model), signal });
      await this.shows(response, photograph);
      this.change({ ...NOTHING, model: true });
      this.use("person");
    });
  }

  // --- hands

  /** Whether the tool draws closed lines, and is no brush. */
  get lines() {
    return this.tool === "lasso" || this.tool === "hole";
  }

  use(tool) {
    this.tool = tool;
    this.corners = [];
    for (const [name, button] of Object.entries(this.buttons))
      button.setAttribute("aria-pressed", String(name === tool));
    this.draw();
  }

  /** The brush's radius in CSS pixels, and as a share of the picture's width. */
  get radius() {
    return 2 + Number(this.size.value) * 0.6;
  }

  get reach() {
    return this.radius / this.paper.width;
  }

  down(event) {
    if (!this.image) return;
    this.canvas.setPointerCapture(event.pointerId);
    this.canvas.classList.add("by-hand"); // the focus is where the hand is: no need to mark it
    this.canvas.focus({ preventScroll: true });
    const place = this.paper.at(event);
    this.pointers.set(event.pointerId, place);
    if (this.pointers.size === 2 || event.button > 0) {
      this.line = null;
      this.panning = { pointers: structuredClone([...this.pointers.values()]), view: this.paper.view };
      return;
    }
    this.pressed = place;
    this.line = [this.paper.share(place)];
    this.freehand = false;
    event.preventDefault();
    this.draw();
  }

  move(event) {
    if (!this.image) return;
    const place = this.paper.at(event);
    this.pen = event.pointerType === "mouse" ? place : null;
    if (!this.pointers.has(event.pointerId)) {
      this.draw();
      return;
    }
    this.pointers.set(event.pointerId, place);
    if (this.panning) this.paper.pan(this.panning.view, this.panning.pointers, [...this.pointers.values()]);
    else if (this.line) {
      if (Math.hypot(place[0] - this.pressed[0], place[1] - this.pressed[1]) > DRAG) this.freehand = true;
      const last = this.paper.spot(this.line.at(-1));
      if (this.freehand && Math.hypot(place[0] - last[0], place[1] - last[1]) >= APART)
        this.line.push(this.paper.share(place));
    }
    this.draw();
  }

  up(event) {
    if (!this.pointers.delete(event.pointerId)) return;
    if (this.panning) {
      if (!this.pointers.size) this.panning = null;
      return;
    }
    const { line } = this;
    this.line = null;
    if (!line || event.type === "pointercancel") return this.draw();
    const again = line.length === 1 && event.timeStamp - this.closedAt < DOUBLE_CLICK;
    if (again) return this.draw(); // the second click of a double click that closed the line
    if (this.tool === "people") this.people.choose(line.at(-1));
    else if (!this.lines) this.stroke(line);
    else if (this.freehand) {
      this.corners.push(...line);
      this.close();
    } else this.corner(line[0]);
    this.draw();
  }

  stroke(points) {
    const { strokes } = this.drawing;
    this.change({
      ...this.drawing,
      strokes: [...strokes, { person: this.tool === "person", points, radius: this.reach }],
    });
  }

  corner(place) {
    const first = this.corners.length > 2 && this.paper.spot(this.corners[0]);
    const [x, y] = this.paper.spot(place);
    if (first && Math.hypot(first[0] - x, first[1] - y) < CLOSE) this.close();
    else this.corners.push(place);
    this.draw();
  }

  /** Closes the line around the person. */
  close() {
    const { corners } = this;
    this.corners = [];
    if (!this.lines || corners.length < 3) return this.draw();
    const hole = this.tool === "hole";
    this.change({ ...this.drawing, ...(hole ? { holes: [...this.drawing.holes, corners] } : { lasso: corners }) });
    this.closedAt = performance.now();
    this.use(hole ? "hole" : "person");
  }

  zoom(times, about) {
    if (!this.image) return;
    this.paper.zoom(times, about);
    this.draw();
  }

  fit() {
    if (!this.image) return;
    this.paper.fit();
    this.draw();
  }

  key(event) {
    this.canvas.classList.remove("by-hand");
    if (event.target.matches("input, dialog *")) return;
    const control = event.ctrlKey || event.metaKey;
    const moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    if (control && event.key.toLowerCase() === "z") event.shiftKey ? this.redo() : this.undo();
    else if (control) return;
    else if (event.target === this.canvas && moves[event.key]) {
      const far = STEP * (event.shiftKey ? 5 : 1);
      const [across, down] = this.pen ? this.paper.share(this.pen) : [0.5, 0.5];
      const [right, low] = moves[event.key];
      this.pen = this.paper.spot([across + right * far, down + low * far]);
    } else if (event.target === this.canvas && event.key === "Enter") {
      const place = this.paper.share(this.pen ?? this.paper.spot([0.5, 0.5]));
      if (this.tool === "people") this.people.choose(place);
      else this.lines ? this.corner(place) : this.stroke([place]);
    } else if (event.key === "c") this.close();
    else if (event.key === "Backspace" || event.key === "Escape") this.corners.length && this.undo();
    else if (event.key === "+" || event.key === "=") this.zoom(1.4);
    else if (event.key === "-") this.zoom(0.7);
    else if (event.key === "0") this.fit();
    else if (event.key === "m" || event.key === "M") this.showGrey(!this.grey);
    else if (event.key === "r" || event.key === "R") this.turnButton.hidden || this.app.turn();
    else if (event.key === "5") this.people.several && this.use("people");
    else if (/^[1-4]$/.test(event.key)) this.use(TOOLS[event.key - 1][0]);
    else return;
    event.preventDefault();
    this.draw();
  }

  // --- showing

  draw() {
    this.frame ??= requestAnimationFrame(() => {
      this.frame = null;
      this.paint();
    });
  }

  paint() {
    const { paper } = this;
    if (!this.image || !paper.view || this.element.hidden) return;
    const busy = Boolean(this.solving);
    const brushes = this.tool === "person" || this.tool === "background";
    paper.begin(this.matte, this.grey && this.matte ? this.greys : null);
    if (!this.matte && this.drawing.lasso) paper.trace(this.drawing.lasso, true);
    if (this.line && brushes) paper.brush(this.line, this.tool === "person", this.radius);
    if (busy)
      for (const { points, person, radius } of this.drawing.strokes.slice(-1))
        paper.brush(points, person, radius * paper.width);
    if (!this.grey) this.people.paint(paper, this.tool === "people" && this.pen && paper.share(this.pen));
    if (this.lines) paper.trace([...this.corners, ...(this.line ?? [])], false, this.corners);
    if (this.pen) paper.pen(this.pen, brushes ? this.radius : null);
    this.say(busy);
  }

  say(busy) {
    const kept = this.drawings.get(this.photograph.id);
    this.undoButton.disabled = !kept.past.length && !this.corners.length;
    this.redoButton.disabled = !kept.future.length;
    this.accept.disabled = !this.matte; // while a newer one is solved it stays: disabled, it would lose a click
    this.greyButton.disabled = !this.matte;
    for (const { input, shown, name } of [this.shift, this.feather]) {
      input.disabled = !this.matte && !this.drawing[name];
      if (document.activeElement === input && input.matches(":active")) continue; // the hand is on it
      input.value = Math.round((this.drawing[name] / EDGE) * 100);
      shown.textContent = this.pixels(this.drawing[name]);
    }
    const [around, next] =
      this.tool === "hole"
        ? ["what does not belong to the person", "Draw a line around what does not belong to the person."]
        : ["the person", "Paint with Person or Background where the edge is wrong."];
    const text = busy
      ? "Finding the edge…"
      : this.tool === "people"
        ? "Click the person whom the light is for, or choose Everyone."
        : this.corners.length
          ? `Continue around ${around}. Click the first corner, or press C, to close the line.`
          : this.matte && this.grey
            ? `White is the person, black is left out. ${next}`
            : this.matte
              ? `The dimmed part is left out. ${next}`
              : "Draw a line around the person. It need not be exact.";
    if (this.hint.textContent !== text) this.hint.textContent = text;
  }
}
