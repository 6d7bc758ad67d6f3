// What buttons and keys do.

import { LIGHTS } from "./engine.js";
import { LOCI, clamp, isNear } from "./lights.js";
import { toPng } from "./png.js";
import { RANGES, checkedLight, toCommand, toFragment, toYaml } from "./state.js";
import { LOOK_NAMES } from "./controls.js";

// Where lights are put one after the other: a key, a rim, a fill, a kicker...
const PLACES = [
  [-40, 30],
  [145, 25],
  [60, 10],
  [-145, 20],
  [0, 70],
  [20, -30],
  [-90, 0],
  [90, 0],
];

const LEVEL = 0.5; // share of the height at which a level camera sees the horizon

export function actionsOf(viewer) {
  const selected = (state) => state.lights[state.selected];
  const change = (mutate, gesture) => viewer.change((state) => mutate(state, selected(state)), gesture);
  const onLight = (mutate, gesture) => {
    change((_, light) => light && mutate(light), gesture);
    viewer.stage.tell();
  };
  const copy = (what, text) => viewer.copy(what, text);
  return {
    aim: (azimuth, elevation) =>
      onLight((light) => {
        if (isNear(light)) {
          const [x, y, z] = light.position;
          light.position = [x + azimuth / 100, y + elevation / 100, z];
          return;
        }
        light.azimuth = ((((light.azimuth + azimuth + 180) % 360) + 360) % 360) - 180;
        light.elevation = clamp(light.elevation + elevation, -90, 90);
      }, "keys"),
    add: () => {
      viewer.stop();
      change((state) => {
        if (state.lights.length >= LIGHTS)
          return viewer.say(`There are ${LIGHTS} lights, the most that the page shows.`);
        const [azimuth, elevation] = PLACES[state.lights.length];
        state.lights.push(checkedLight({ name: freeName(state.lights), azimuth, elevation, angle: 10 }));
        state.selected = state.lights.length - 1;
      });
    },
    remove: (index) => {
      viewer.stop();
      change((state) => {
        state.lights.splice(index, 1);
        const next = state.selected - Number(state.selected > index);
        state.selected = Math.max(0, Math.min(next, state.lights.length - 1));
      });
    },
    toggle: (key) => change((_, light) => light && (light[key] = !light[key])),
    push: (centimetres) =>
      onLight((light) => {
        if (isNear(light)) light.position = viewer.room.pushed(light.position, centimetres / 100);
        else viewer.say("A distant light has no distance: D brings it near.");
      }, "keys"),
    switch: () => {
      change((state, light) => light && (state.lights[state.selected] = viewer.room.switched(light)));
      const light = selected(viewer.state);
      if (light && isNear(light) && viewer.room.camera.guessed)
        viewer.say("The frame cuts the person: metres are as if it showed 1.75 of them. Give relight view --height.");
    },
    brighten: (step) => onLight((light) => (light.exposure = clamp(light.exposure + step, ...RANGES.exposure)), "keys"),
    soften: (steps) =>
      onLight((light) => {
        if (isNear(light)) light.radius = clamp(light.radius + steps / 100, 0, viewer.room.height);
        else light.angle = clamp(light.angle + 2 * steps, ...RANGES.angle);
      }, "keys"),
    warmth: (mireds) =>
      onLight(
        (light) =>
          (light.temperature = clamp(1e6 / (1e6 / (light.temperature ?? 6500) + mireds), ...LOCI[light.locus])),
        "keys",
      ),
    orbit: () => (viewer.playing === null ? viewer.play() : viewer.stop()),
    turn: (degrees) =>
      viewer.state.environment
        ? change((state) => (state.environment.rotation += degrees), "keys")
        : viewer.say("There is no environment to turn: drop a map on the panel."),
    muteEnvironment: () => change((state) => state.environment && (state.environment.muted = !state.environment.muted)),
    nextBackground: () => {
      const { background, picture } = viewer.state;
      const kinds = [
        ...(viewer.original ? ["original"] : []),
        "none",
        "colour",
        ...(viewer.pictures[picture] ? ["picture"] : []),
      ];
      const kind = background === null ? "none" : Array.isArray(background) ? "colour" : background;
      viewer.setBackgroundKind(kinds[(kinds.indexOf(kind) + 1) % kinds.length]);
    },
    switchFloor: () => {
      const { size, box } = viewer.pack.description;
      const soles = (box[1] + box[3]) / size[1];
      if (!viewer.state.floor && soles >= 1) {
        viewer.say("The frame cuts the feet off: there is no floor on which a shadow could fall.");
        viewer.refresh();
        return;
      }
      change((state) => (state.floor = state.floor ? null : { horizon: Math.min(LEVEL, 0.8 * soles) }));
    },
    look: (look) => {
      if (!viewer.engine.looks.includes(look))
        return viewer.say(`${LOOK_NAMES[look]}: needs WebGL 2, which this browser does not have.`);
      change((state) => (state.look = look));
      viewer.say(LOOK_NAMES[look]);
    },
    wipe: () =>
      change(
        (state) =>
          (state.wipe = state.wipe ? null : { look: state.look === "photograph" ? "picture" : "photograph", at: 0.5 }),
      ),
    moveWipe: (step) => change((state) => state.wipe && (state.wipe.at = clamp(state.wipe.at + step, 0, 1)), "keys"),
    expose: (stops) => {
      change((state) => (state.exposure = clamp(state.exposure + stops, ...RANGES.exposure)), "keys");
      viewer.say(`Exposure ${viewer.state.exposure.toFixed(2)} stops`);
    },
    hide: () => {
      viewer.bare = !viewer.bare;
      viewer.refresh();
    },
    copyLights: () => copy("The lights", toYaml(viewer.state, viewer.environment)),
    copyCommand: () => {
      const unnamed = typeof viewer.state.background === "string" && !viewer.backdrop?.name;
      return copy(
        unnamed ? "The command, without the background (it has no file)" : "The command",
        toCommand(viewer.state, viewer.environment, viewer.scene, viewer.backdrop),
      );
    },
    copyLink: () => {
      const { environment, map, background, picture } = viewer.state;
      const files = [
        environment && map && viewer.environment.path,
        background === "picture" && picture && viewer.backdrop.name,
      ].filter(Boolean);
      return copy(
        files.length ? `The link (${files.join(" and ")} must be dropped on the page again)` : "The link",
        `${location.href.split("#")[0]}#${toFragment(viewer.state, viewer)}`,
      );
    },
    copyPicture: async () => {
      viewer.stop();
      viewer.redraw();
      const { look, exposure } = viewer.state;
      const png = toPng(viewer.engine.readShown(look, { exposure, background: viewer.shownBackground() }));
      viewer.redraw();
      try {
        await navigator.clipboard.write([new ClipboardItem({ "image/png": png })]); // a promise: the click still counts
        viewer.say("The picture: copied, as large as it is here.");
      } catch {
        viewer.say("The browser does not let the page copy pictures: save it instead.");
      }
    },
    save: async () => {
      if (viewer.host) return viewer.host.save(); // at full resolution
      const { look, exposure } = viewer.state;
      viewer.stop();
      viewer.redraw();
      const png = await toPng(viewer.engine.readShown(look, { exposure, background: viewer.shownBackground() }));
      viewer.redraw();
      const link = document.createElement("a");
      link.href = URL.createObjectURL(png);
      link.download = `${viewer.scene.title.replace(/\.\w+$/, "")}-relit.png`;
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10000);
      viewer.say(`Saved ${link.download}`);
    },
    undo: () => viewer.step(viewer.past, viewer.future),
    redo: () => viewer.step(viewer.future, viewer.past),
    help: () => viewer.help.showModal(),
  };
}

function freeName(lights) {
  const names = ["key", "rim", "fill", "kicker", "top", "low", "left", "right"];
  const taken = new Set(lights.map((light) => light.name));
  return names.find((name) => !taken.has(name)) ?? "";
}
