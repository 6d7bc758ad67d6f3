// The application: four steps, one photograph at a time, and what they share.

import { h, iconButton, preferredSurround, surround } from "../viewer.js";
import { Drop } from "./drop.js";
import { Light } from "./light.js";
import { OutlineStep } from "./outline.js";
import { remarkOf } from "./people.js";
import { keepForReload, keptForReload } from "./reload.js";
import { Refused, ask, askJson, follow, previewOf } from "./requests.js";
import { Save } from "./save.js";

const STEPS = [
  ["drop", "Photograph"],
  ["outline", "Outline"],
  ["light", "Light"],
  ["save", "Save files"],
];

const TOLD = [6000, 20000]; // milliseconds that something is said: a note, and what calls for something

class Application {
  constructor(root) {
    this.root = root;
    surround([root], preferredSurround());
    this.photographs = [];
    this.chosen = null; // the photograph at hand
    this.step = "drop";
    this.about = { root: [], models: [], suffixes: [] };
    this.message = h("div", { class: "notice", role: "alert", hidden: true });
    this.steps = Object.fromEntries(
      STEPS.map(([name, label], index) => [
        name,
        h(
          "button",
          { type: "button", class: "step", onclick: () => this.go(name) },
          h("span", { class: "number", "aria-hidden": "true" }, `${index + 1}`),
          h("span", {}, label),
        ),
      ]),
    );
    this.strip = h("ul", { class: "strip", "aria-label": "Photographs" });
    this.progress = this.progressSheet();
    this.parts = { drop: new Drop(this), outline: new OutlineStep(this), light: new Light(this), save: new Save(this) };
    this.main = h("main", {}, ...Object.values(this.parts).map((part) => part.element));
    root.append(
      h(
        "header",
        { class: "bar" },
        h("h1", {}, "relight"),
        h("nav", { "aria-label": "Steps" }, h("ol", {}, ...STEPS.map(([name]) => h("li", {}, this.steps[name])))),
        this.strip,
      ),
      this.main,
      this.progress,
    );
    this.main.append(this.message);
    this.listen();
  }

  async begin() {
    history.replaceState({ step: "drop" }, "");
    this.show("drop");
    await this.trying(async () => {
      this.about = await askJson("session");
      this.photographs = this.about.photographs;
      this.parts.drop.refresh();
      this.refresh();
      await this.resume();
    });
    addEventListener("pagehide", () => this.keep());
    return this;
  }

  // --- a page that is loaded again

  keep() {
    const { outline, light } = this.parts;
    keepForReload({ step: this.step, chosen: this.chosen?.id, drawings: [...outline.drawings], rig: light.keptRig() });
  }

  /** Goes on where the page was when it was loaded last. */
  async resume() {
    const kept = keptForReload();
    const photograph = this.photographs.find(({ id }) => id === kept?.chosen);
    if (!kept) return;
    this.parts.outline.drawings = new Map(kept.drawings);
    await this.parts.light.restore(kept.rig);
    if (!photograph) return;
    this.chosen = photograph;
    await this.go(this.may(kept.step) ? kept.step : "outline");
  }

  listen() {
    addEventListener("popstate", (event) => event.state?.step && this.go(event.state.step));
    addEventListener("unhandledrejection", (event) => this.fail(event.reason));
    addEventListener("error", (event) => this.fail(event.error));
    const { root } = this;
    const brings = (event) => [...(event.dataTransfer?.types ?? [])].includes("Files");
    root.addEventListener("dragover", (event) => {
      if (!brings(event)) return;
      event.preventDefault();
      root.classList.add("dropping");
    });
    root.addEventListener("dragleave", (event) => event.relatedTarget || root.classList.remove("dropping"));
    root.addEventListener("drop", (event) => {
      root.classList.remove("dropping");
      if (event.defaultPrevented || !brings(event)) return; // the light takes backgrounds and environments
      event.preventDefault();
      this.add([...event.dataTransfer.files]);
    });
    addEventListener("paste", (event) => {
      const files = [...(event.clipboardData?.files ?? [])];
      if (files.length) this.add(files);
    });
  }

  // --- photographs

  /** Uploads files, and goes on with the first of them. */
  async add(files) {
    const [known, other] = [[], []];
    for (const file of files)
      (this.about.suffixes.some((suffix) => file.name.toLowerCase().endsWith(suffix)) ? known : other).push(file);
    const problems = other.length
      ? [`${other[0].name}${other.length > 1 ? ` and ${other.length - 1} more` : ""}: no picture that can be read.`]
      : [];
    let first = null;
    await this.busy(async (say, signal) => {
      for (const [index, file] of known.entries()) {
        say(known.length > 1 ? `Reading ${file.name}, ${index + 1} of ${known.length}` : `Reading ${file.name}`);
        try {
          const photograph = await askJson(`photographs?name=${encodeURIComponent(file.name)}`, { body: file, signal });
          this.photographs.push(photograph);
          first ??= photograph;
          this.refresh();
        } catch (error) {
          if (!(error instanceof Refused)) throw error;
          problems.push(error.message);
          if (/the most that fit/.test(error.message)) break;
        }
      }
    });
    if (first) await this.choose(first);
    if (problems.length) this.tell(problems.join(" "), true);
  }

  /** Adds one that the server has: the example, or a file of the folder. */
  async addFrom(path, value) {
    await this.busy(async (say, signal) => {
      say("Reading");
      const photograph = await askJson(path, { body: JSON.stringify(value), signal });
      this.photographs.push(photograph);
      await this.choose(photograph);
    });
  }

  /** Goes on with a photograph, at the step that it has come to. */
  async choose(photograph) {
    this.chosen = photograph;
    this.refresh();
    if (photograph.analysed) await this.go("light");
    else if (photograph.cut_out) return this.analyse(null, photograph.notes ?? []);
    else if (this.about.finder === "ready" && !this.parts.outline.drawings.has(photograph.id))
      return this.findPerson(photograph, photograph.notes ?? []);
    else await this.go("outline");
    if (this.chosen === photograph && this.message.hidden && photograph.notes?.length)
      this.tell(photograph.notes.join(" "));
  }

  async remove(photograph) {
    await this.trying(() => ask(`photographs/${photograph.id}`, { method: "DELETE" }));
    const place = this.photographs.indexOf(photograph);
    this.photographs = this.photographs.filter((other) => other !== photograph);
    if (this.chosen === photograph) {
      this.chosen = null;
      await this.go("drop");
    }
    this.refresh();
    this.tell(`Removed ${photograph.name}.`, true, ["Undo", () => this.bringBack(photograph, place)]);
  }

  async bringBack(photograph, place) {
    this.hush();
    await this.trying(async () => {
      await askJson(`photographs/${photograph.id}/back`, { method: "POST" });
      this.photographs.splice(place, 0, photograph);
      await this.choose(photograph);
    });
  }

  /** Finds the person and opens the light; where that fails, the outline is drawn. */
  async findPerson(photograph, said = []) {
    let [reason, act] = ["", null];
    await this.busy(async (say, signal) => {
      say("Finding the person");
      try {
        const found = await follow(`photographs/${photograph.id}/person`, { person: 1 }, say, signal);
        photograph.people = found.people;
        const remark = remarkOf(found, this);
        if (!found.model) ({ text: reason, act } = remark);
        else
          await this.analyse(
            this.parts.outline.foundByModel(photograph, found.model),
            [...said, ...found.notes],
            remark,
          );
      } catch (error) {
        if (!(error instanceof Refused) && error?.name !== "AbortError") throw error;
        reason = error instanceof Refused ? error.message : "Cancelled.";
      }
    });
    if (!reason || this.chosen !== photograph) return;
    await this.go("outline");
    this.tell([...said, reason].join(" "), true, act);
  }

  /** Turns the photograph clockwise, by quarters, and begins with it again. */
  async turn(turns = 1) {
    const { chosen } = this;
    await this.busy(async (say) => {
      say("Turning the photograph");
      Object.assign(chosen, await askJson(`photographs/${chosen.id}/turn`, { body: JSON.stringify({ turns }) }));
      this.parts.outline.forget(chosen);
      this.parts.light.forget(chosen);
      await this.choose(chosen);
    });
  }

  /** Brings the networks that find people, when it has been asked for; whether they are there now. */
  async fetchFinder() {
    await this.fetchNetworks("person", "Fetching the networks that find people", "People are found from now on.");
    return this.about.finder === "ready";
  }

  /** Brings the network that cuts people out, when it has been asked for. */
  async fetchSilhouette() {
    const after = "Hair, hands and what people hold are kept from now on.";
    await this.fetchNetworks("silhouette", "Fetching the network that cuts people out", after);
  }

  async fetchNetworks(route, before, after) {
    await this.busy(async (say, signal) => {
      say(before);
      Object.assign(this.about, await follow(route, {}, say, signal));
      this.parts.drop.refresh();
      this.tell(after);
    });
  }

  /**
   * Accepts an outline, `drawn`, or the photograph's own: the light opens when the person is analysed. `said`: what
   * was warned of before; `remark`: what is odd, and a button, see `remarkOf`.
   */
  async analyse(drawn, said = [], remark = null) {
    const { chosen } = this;
    await this.busy(async (say, signal) => {
      say("Analysing the person");
      const { photograph, notes } = await follow(`photographs/${chosen.id}/analyse`, { drawn }, say, signal);
      Object.assign(chosen, photograph);
      this.parts.light.forget(chosen);
      await this.go("light");
      const all = [...said, ...notes, ...(remark ? [remark.text] : [])];
      if (all.length) this.tellMore(all.join(" "), remark?.act);
    });
  }

  // --- steps

  may(step) {
    const { chosen } = this;
    if (step === "drop") return true;
    if (step === "outline") return Boolean(chosen);
    return Boolean(chosen?.analysed);
  }

  async go(step) {
    if (!this.may(step)) return;
    this.show(step);
    await this.trying(() => this.parts[step].open?.());
    if (!this.aborting) this.parts[step].focus();
  }

  show(step) {
    this.step = step;
    if (history.state?.step !== step) history.pushState({ step }, ""); // the browser's Back goes a step back
    this.hush();
    if (step !== "light") this.parts.light.viewer?.stop(); // an orbit does not go on out of sight
    for (const [name, part] of Object.entries(this.parts)) part.element.hidden = name !== step;
    this.root.dataset.step = step;
    this.refresh();
  }

  refresh() {
    for (const [name, button] of Object.entries(this.steps)) {
      button.disabled = !this.may(name);
      button.toggleAttribute("aria-current", name === this.step);
      if (name === this.step) button.setAttribute("aria-current", "step");
    }
    this.strip.hidden = !this.photographs.length || (this.photographs.length === 1 && Boolean(this.chosen));
    this.strip.replaceChildren(
      ...this.photographs.map((photograph) =>
        h(
          "li",
          { class: photograph === this.chosen ? "chosen" : "" },
          h(
            "button",
            {
              type: "button",
              class: "thumb",
              title: photograph.name,
              "aria-label": photograph.name,
              "aria-pressed": String(photograph === this.chosen),
              onclick: () => this.choose(photograph),
            },
            h("img", { src: previewOf(photograph), alt: "" }),
          ),
          iconButton("delete", `Remove ${photograph.name}`, () => this.remove(photograph)),
        ),
      ),
    );
  }

  // --- saying

  progressSheet() {
    this.doing = h("p", { role: "status", "aria-live": "polite" });
    this.cancel = h("button", { type: "button", class: "quiet", onclick: () => this.aborting?.abort() }, "Cancel");
    this.track = h(
      "div",
      { class: "track", role: "progressbar", "aria-label": "Progress", "aria-valuemin": 0, "aria-valuemax": 100 },
      h("i"),
    );
    const sheet = h("dialog", { class: "progress", "aria-label": "Working" }, this.track, this.doing, this.cancel);
    sheet.addEventListener("cancel", (event) => {
      event.preventDefault();
      this.aborting?.abort();
    });
    return sheet;
  }

  /** Shows how much of what is done is done, a share; null where that is not known. */
  showShare(share) {
    this.track.classList.toggle("measured", share !== null);
    this.track.firstChild.style.width = share === null ? "" : `${100 * share}%`;
    if (share === null) this.track.removeAttribute("aria-valuenow");
    else this.track.setAttribute("aria-valuenow", Math.round(100 * share));
  }

  /** Does what takes a while: it is told, and can be cancelled. Within something busy it is a part of that. */
  async busy(work) {
    const say = (text, share = null) => {
      this.doing.textContent = `${text}…`;
      this.showShare(share);
    };
    if (this.aborting) return work(say, this.aborting.signal);
    this.aborting = new AbortController();
    const began = this.step;
    this.hush();
    this.progress.showModal();
    try {
      await this.trying(() => work(say, this.aborting.signal));
    } finally {
      this.aborting = null;
      this.progress.close();
      if (this.step !== began) this.parts[this.step].focus(); // the dialogue has given it back to what is hidden now
    }
  }

  /** Does something; what is refused is said. */
  async trying(work) {
    try {
      return await work();
    } catch (error) {
      this.fail(error);
    }
  }

  fail(error) {
    if (error?.name === "AbortError") this.tell("Cancelled.");
    else if (error instanceof Refused) this.tell(error.message, true);
    else {
      this.tell(`Something went wrong in the page: ${error?.message ?? error}`, true);
      if (error) console.error(error);
    }
  }

  /**
   * Says something for a while, where it covers no hint; `kept`: for longer. `acts`: [label, what a button does], or
   * null.
   */
  tell(text, kept = false, ...acts) {
    clearTimeout(this.telling);
    const button = ([label, onclick]) => h("button", { type: "button", class: "quiet", onclick }, label);
    this.said = [text, ...acts.filter(Boolean)];
    this.message.replaceChildren(
      h("span", {}, text),
      ...[...this.said.slice(1), ["Close", () => this.hush()]].map(button),
    );
    (this.parts[this.step].noticePlace?.() ?? this.main).append(this.message);
    this.message.hidden = false;
    this.telling = setTimeout(() => this.hush(), TOLD[Number(kept)]);
  }

  /** Says something beside what is being said; with a button it stays until it is closed, or the step changes. */
  tellMore(text, act) {
    const [before, ...acts] = this.message.hidden ? [] : this.said;
    this.tell([before, text].filter(Boolean).join(" "), true, ...acts, act);
    if (act) clearTimeout(this.telling);
  }

  hush() {
    this.message.hidden = true;
  }
}

window.relightApp = await new Application(document.getElementById("app")).begin();
