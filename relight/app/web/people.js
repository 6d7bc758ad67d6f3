// Who was found in the photograph: outlined lightly, and chosen by a click; and what is odd about whom was found.

import { h } from "../viewer.js";

export class People {
  /** `onchoose(person)`: a number, or "everyone"; `onuse()`: the tool was chosen. */
  constructor(onchoose, onuse) {
    this.onchoose = onchoose;
    this.found = []; // [{ number, lines }], lines of places as shares of the photograph
    const title = "Click the person whom the light is for (5)";
    this.tool = h("button", { type: "button", class: "tool", title, onclick: onuse }, "Choose person");
    this.element = h(
      "div",
      { class: "group", role: "group", "aria-label": "People", hidden: true },
      this.tool,
      h("button", { type: "button", class: "tool", onclick: () => onchoose("everyone") }, "Everyone"),
    );
  }

  show(found) {
    this.found = found ?? [];
    this.element.hidden = !this.several;
  }

  get several() {
    return this.found.length > 1;
  }

  /** Who is at a place; the smallest of several, who stands in front. */
  at(place) {
    return [...this.found].reverse().find(({ lines }) => lines.some((line) => holds(line, place)));
  }

  choose(place) {
    const person = this.at(place);
    if (person) this.onchoose(person.number);
  }

  /** Outlines everybody on a Paper; whoever is at `place` is marked. */
  paint(paper, place) {
    if (!this.several) return;
    const marked = place && this.at(place);
    for (const person of this.found) for (const line of person.lines) paper.contour(line, person === marked);
  }
}

/** Whether a place is within a closed line, by the even-odd rule. */
function holds(line, [x, y]) {
  let inside = false;
  line.forEach(([right, low], index) => {
    const [left, top] = line.at(index - 1);
    if (low > y !== top > y && x < left + ((right - left) * (y - top)) / (low - top)) inside = !inside;
  });
  return inside;
}

/** What the page says of whom it lights: { text, act: [label, what a button does] }; null where nothing is odd. */
export function remarkOf({ oddity, turns, people }, app) {
  const outline = () => app.go("outline");
  if (oddity === "turned") {
    const text = turns === 2 ? "The picture seems to be upside down." : "The picture seems to lie on its side.";
    return { text, act: ["Turn it", () => app.turn(turns)] };
  }
  if (oddity === "uncertain")
    return { text: "It is uncertain whether this is a person: look at the outline.", act: ["Outline", outline] };
  if (oddity === "small")
    return { text: "Only a small part of a person was found: look at the outline.", act: ["Outline", outline] };
  if (people.length < 2) return null;
  return { text: `${people.length} people were found, and the largest is lit.`, act: ["Choose", outline] };
}
