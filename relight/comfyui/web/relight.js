// ComfyUI extension: the page of `relight view` inside the node Relight Viewer. The page stands in a frame of its
// own, so that styles, keys and the canvas' zoom stay apart. Its lights go to the node's `held` input.

import { app } from "../../scripts/app.js";
import { api } from "../../scripts/api.js";

const BEFORE = "Run the workflow once: the person appears here.";
const GONE = "The page is no longer there. Run the workflow again.";
const SIZE = [880, 640]; // of a new node: the page has its panel beside the person
const SETTLED = 300; // milliseconds without a change, after which ComfyUI is told

class ViewerPage {
  constructor(node) {
    this.filename = null; // of the page that is shown
    this.url = null;
    this.held = node.widgets.find((widget) => widget.name === "held");
    this.held.hidden = true;
    this.held.computeSize = () => [0, -4]; // for frontends that do not know `hidden`
    this.frame = document.createElement("iframe");
    this.frame.title = "The person with the lights in your hand";
    this.frame.addEventListener("load", () => this.loaded());
    this.hint = document.createElement("p");
    this.element = document.createElement("div");
    this.element.append(this.frame, this.hint);
    Object.assign(this.element.style, {
      width: "100%",
      height: "100%",
      background: "#1b1b1b",
      borderRadius: "6px",
      overflow: "hidden",
      display: "grid",
      placeItems: "center",
    });
    Object.assign(this.frame.style, { width: "100%", height: "100%", border: "0", gridArea: "1 / 1" });
    Object.assign(this.hint.style, { gridArea: "1 / 1", color: "#a3a09b", font: "13px sans-serif", margin: "0" });
    this.say(BEFORE);
    const reset = node.addWidget("button", "Take the lights that come in", null, () => this.reset());
    const page = node.addDOMWidget("page", "relight_page", this.element, {
      serialize: false,
      hideOnZoom: false,
      getMinHeight: () => 360,
    });
    reset.serialize = page.serialize = false;
    node.setSize([Math.max(node.size[0], SIZE[0]), Math.max(node.size[1], SIZE[1])]);
  }

  say(text) {
    this.hint.textContent = text;
    this.frame.hidden = Boolean(text);
  }

  /** Shows a page that the node wrote, unless it is shown already. */
  async show(file) {
    if (!file || file.filename === this.filename) return;
    const response = await api.fetchApi(`/view?${new URLSearchParams(file)}`);
    if (!response.ok) {
      this.say(GONE);
      return;
    }
    this.close();
    this.filename = file.filename;
    this.url = URL.createObjectURL(new Blob([await response.text()], { type: "text/html" }));
    this.say("");
    this.open();
  }

  open() {
    if (this.url) this.frame.src = this.held.value ? `${this.url}#${this.held.value}` : this.url;
  }

  close() {
    if (this.url) URL.revokeObjectURL(this.url);
    this.url = this.filename = null;
  }

  loaded() {
    const page = this.frame.contentWindow;
    if (!this.url || !page) return;
    const listen = () => page.relight.viewer.listeners.add(() => this.hold(page.relight.link()));
    if (page.relight) listen();
    else page.addEventListener("relight", listen, { once: true });
  }

  hold(link) {
    if (link === this.held.value) return;
    this.held.value = link;
    clearTimeout(this.telling);
    // Undo and "queue on change" look at the graph after the hand has come to rest.
    this.telling = setTimeout(
      () => app.extensionManager?.workflow?.activeWorkflow?.changeTracker?.checkState?.(),
      SETTLED,
    );
  }

  reset() {
    this.held.value = "";
    this.open();
  }
}

app.registerExtension({
  name: "relight.viewer",
  nodeCreated(node) {
    if (node.comfyClass !== "RelightViewer") return;
    const page = new ViewerPage(node);
    const { onExecuted, onRemoved } = node;
    node.onExecuted = function (output) {
      onExecuted?.apply(this, arguments);
      page.show(output?.relight_viewer?.[0]);
    };
    node.onRemoved = function () {
      onRemoved?.apply(this, arguments);
      page.close();
    };
  },
});
