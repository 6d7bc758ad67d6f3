// Strokes of light become lights: non-negative least squares of the light at points of the person.
//
// What relight/light_painting.py and relight/analysis/light_solver.py do, in grey, and without their search: a new
// light stands where its candidates have their mean, and new lights have one angle.

import { decoded } from "./colour.js";
import { LIGHTS } from "./engine.js";
import { DEGREE, LUMINANCE, angles, direction, dot, isNear, power, samples } from "./lights.js";
import { fromHalf } from "./room.js";
import { checkedLight, shining } from "./state.js";

const POINT_ROWS = 64; // of the grid of points
const FEW = 4; // lights at most, unless there are more
const STROKE_STOPS = 0.5; // by which a stroke makes the light brighter or darker; strokes over each other add up
const MOST_STOPS = 4;
const KEPT_WEIGHT = 0.05; // of all that is not painted, beside 1 for the mean under strokes
const PATTERN_WEIGHT = 0.05; // of the pattern of light under strokes
const SHADOW_LIGHT = 0.05; // of the mean light: what a stroke multiplies where there is less
const DARK_SHARE = 0.1; // of the mean, added to a value before the square root that its error is relative to
const RIDGE = 1e-3; // relative to the mean squared column
const SPARSITY = 0.02; // price of a new light's power, as a share of the most that any is worth
const FAINT = 0.02; // share of all light below which a candidate is left out
const MERGED = 25 * DEGREE; // within which lights are one
const USELESS = 0.002; // share of the wanted change that a light must be worth
const DISCS = [0, 20, 40, 70]; // degrees: angular diameters that are tried
const SWEEPS = 2000;

/** The person at a grid of 64 rows: what a light does there, in luminance. */
export class PersonPoints {
  constructor({ pack, room, engine }) {
    const { description, arrays, images } = pack;
    const [width, height] = description.canvas;
    const step = Math.max(1, Math.floor(height / POINT_ROWS));
    const [left, top, across, down] = description.box;
    const codes = codesOf(images.albedo, across, down);
    const pixels = [];
    this.places = []; // shares of the picture's width and height
    this.albedo = []; // luminance
    for (let y = step >> 1; y < height; y += step)
      for (let x = step >> 1; x < width; x += step) {
        const pixel = y * width + x;
        if (room.known[pixel] < 128) continue;
        const column = (x + 0.5 - width / 2) / description.scale + description.centre[0];
        const row = (y + 0.5 - height / 2) / description.scale + description.centre[1];
        const at = 4 * (clamped(row, down) * across + clamped(column, across));
        pixels.push(pixel);
        this.places.push([(left + column) / description.size[0], (top + row) / description.size[1]]);
        this.albedo.push(
          dot(
            LUMINANCE,
            [0, 1, 2].map((channel) => decoded(codes[at + channel] / 255)),
          ),
        );
      }
    const planes = arrays.features.shape[0];
    this.count = pixels.length;
    this.cell = step / description.scale / description.size[1]; // height of a cell, a share of the picture's
    this.aspect = description.size[0] / description.size[1];
    this.bias = description.residualBias;
    this.engine = engine;
    this.features = new Float32Array(this.count * planes);
    this.surface = new Float32Array(this.count * 4); // normal, and the slope of the gate
    this.positions = new Float32Array(this.count * 3);
    pixels.forEach((pixel, point) => {
      for (let plane = 0; plane < planes; plane++)
        this.features[point * planes + plane] = arrays.features.data[plane * width * height + pixel] / 255;
      for (let plane = 0; plane < 4; plane++)
        this.surface[point * 4 + plane] = fromHalf(arrays.surface.data[plane * width * height + pixel]);
      this.positions.set(room.positions.subarray(pixel * 4, pixel * 4 + 3), point * 3);
    });
    this.anchors = engine.mixes.anchors;
    this.ofAnchors = this.anchors.map((toward) => this.picture([{ toward, power: [1, 1, 1] }]));
  }

  /** The picture of what a light comes down to, see `samples` of lights.js: a value a point. */
  picture(of, colour = [1, 1, 1]) {
    const total = new Float64Array(this.count);
    if (isNear(of)) {
      for (let point = 0; point < this.count; point++) {
        const ray = of.position.map((value, axis) => value - this.positions[point * 3 + axis]);
        const squared = dot(ray, ray);
        const toward = ray.map((value) => value / Math.sqrt(squared));
        total[point] = this.shading(point, toward, this.engine.weightsOf(toward)) / squared;
      }
    } else
      for (const sample of of) {
        const weights = this.engine.weightsOf(sample.toward);
        const strength = dot(LUMINANCE, sample.power);
        for (let point = 0; point < this.count; point++)
          total[point] += strength * this.shading(point, sample.toward, weights);
      }
    const grey = dot(LUMINANCE, colour);
    return total.map((value, point) => value * grey * this.albedo[point]);
  }

  /** shaders/light.glsl at a point. */
  shading(point, toward, { shadow, bounce }) {
    const { features, surface } = this;
    const ranks = [shadow.length - 1, bounce.length - 1];
    const start = point * (ranks[0] + ranks[1]);
    let logit = shadow[ranks[0]];
    let residual = bounce[ranks[1]];
    for (let k = 0; k < ranks[0]; k++) logit += shadow[k] * features[start + k];
    for (let k = 0; k < ranks[1]; k++) residual += bounce[k] * features[start + ranks[0] + k];
    const facing = dot(surface.subarray(point * 4, point * 4 + 3), toward);
    const visibility = 1 / (1 + Math.exp(-logit)) / (1 + Math.exp(-surface[point * 4 + 3] * facing));
    residual -= Math.min(Math.max(residual, 0), this.bias);
    return Math.min(Math.max(Math.max(facing, 0) * visibility + residual, 0), 1);
  }

  /** The light of a state: { sources: lights that shine, with their pictures, rest: the others, around }. */
  lit(viewer, state) {
    const active = new Set(shining(state));
    const sources = state.lights
      .filter((light) => active.has(light))
      .map((light) => ({ light, picture: this.picture(samples(light), power(light, viewer.tints)) }));
    const around = viewer.surroundings(state);
    if (around) sources.push({ light: null, picture: this.picture(around.samples, around.colour) });
    return { sources, rest: state.lights.filter((light) => !active.has(light)), state, tints: viewer.tints };
  }
}

const clamped = (value, count) => Math.min(Math.max(Math.floor(value), 0), count - 1);

/** The codes of an image, RGBA bytes. */
function codesOf(image, width, height) {
  const context = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
  context.drawImage(image, 0, 0);
  return context.getImageData(0, 0, width, height).data;
}

/**
 * The lights that strokes ask for: { lights, environment: its intensity, strokes: [{ asked, reached }] }; null if the
 * strokes are beside the person, or cancel each other. `lit`: what `PersonPoints.lit` gave for the state with which
 * painting began.
 */
export function paintedLights(points, lit, strokes) {
  const stops = stopsOf(points, strokes);
  const covers = [1, -1]
    .map((sign) => stops.map((value) => Math.min(Math.max((sign * value) / STROKE_STOPS, 0), 1)))
    .filter((cover) => cover.some((share) => share > 0.05));
  if (!covers.length) return null;
  const problem = new Wanted(points, lit, stops, covers);
  const { state } = lit;
  const lamps = lit.sources.filter(({ light }) => light).length;
  const room = LIGHTS - lit.rest.length;
  const found = problem.solve(Math.min(room, Math.max(FEW, lamps)), lit.tints);
  const factors = new Map(found.sources.map(({ own }, index) => [own, found.powers[index]]));
  const names = new Set(state.lights.map(({ name }) => name));
  let number = 0;
  const fresh = () => {
    do number++;
    while (names.has(`paint${number}`));
    return `paint${number}`;
  };
  const lights = found.sources.flatMap(({ light }, index) =>
    light && found.powers[index] > 0
      ? [{ ...light, name: light.name ?? fresh(), intensity: light.intensity * found.powers[index] }]
      : [],
  );
  const around = lit.sources.find(({ light }) => !light);
  const { environment } = state;
  return {
    lights: [...lights, ...lit.rest],
    environment: environment ? environment.intensity * (around ? (factors.get(around) ?? 0) : 1) : 0,
    strokes: covers.map((cover) => ({
      asked: 2 ** weighted(stops, cover),
      reached: weighted(found.picture, cover) / weighted(problem.before, cover),
    })),
  };
}

const weighted = (values, weights) => {
  let sum = 0;
  let whole = 0;
  values.forEach((value, index) => {
    sum += value * weights[index];
    whole += weights[index];
  });
  return sum / whole;
};

/** By how many stops strokes make each point brighter. */
function stopsOf({ places, cell, aspect, count }, strokes) {
  const stops = new Float64Array(count);
  for (const { points, radius, brighter } of strokes)
    for (let point = 0; point < count; point++) {
      let least = Infinity;
      for (let index = 0; index < points.length; index++)
        least = Math.min(least, apartFrom(places[point], points[index], points[Math.max(index - 1, 0)], aspect));
      const share = Math.min(Math.max((radius - least) / cell + 0.5, 0), 1);
      stops[point] += (brighter ? STROKE_STOPS : -STROKE_STOPS) * share;
    }
  return stops.map((value) => Math.min(Math.max(value, -MOST_STOPS), MOST_STOPS));
}

/** The distance of a place from a line, as a share of the picture's height; places are shares of width and height. */
function apartFrom(place, from, to, aspect) {
  const across = [(to[0] - from[0]) * aspect, to[1] - from[1]];
  const away = [(place[0] - from[0]) * aspect, place[1] - from[1]];
  const squared = across[0] ** 2 + across[1] ** 2;
  const along = squared ? Math.min(Math.max((away[0] * across[0] + away[1] * across[1]) / squared, 0), 1) : 0;
  return Math.hypot(away[0] - along * across[0], away[1] - along * across[1]);
}

/** Least squares of pictures, weighted: the means under strokes, their pattern, and all else as it is. */
class Wanted {
  constructor(points, lit, stops, covers) {
    this.points = points;
    this.own = lit.sources;
    this.before = new Float64Array(points.count);
    for (const { picture } of this.own) picture.forEach((value, point) => (this.before[point] += value));
    const sum = (values) => values.reduce((total, value) => total + value, 0);
    const light = sum(this.before) / sum(points.albedo);
    const asked = this.before.map((value, point) => {
      const factor = 2 ** stops[point];
      const multiplied = Math.max(value, SHADOW_LIGHT * light * points.albedo[point]);
      return factor > 1 ? value + (factor - 1) * multiplied : value * factor;
    });
    this.covers = covers;
    const covered = stops.map((_, point) => Math.max(...covers.map((cover) => cover[point])));
    const [painted, left] = [sum(covered), Math.max(points.count - sum(covered), 1)];
    const weights = covered.map((share) => (PATTERN_WEIGHT * share) / painted + (KEPT_WEIGHT * (1 - share)) / left);
    const [present, wanted] = [this.before, asked].map((values) => this.withMeans(values));
    const most = present.map((value, index) => Math.max(value, wanted[index]));
    const dark = (DARK_SHARE * sum(most)) / most.length + 1e-12;
    this.scale = most.map((value, index) => Math.sqrt((weights[index] ?? 1) / (value + dark)));
    this.wanted = wanted.map((value, index) => value * this.scale[index]);
    this.squared = inner(this.wanted, this.wanted);
    this.useless = USELESS * sum(present.map((value, index) => ((value - wanted[index]) * this.scale[index]) ** 2));
  }

  withMeans(picture) {
    return Float64Array.from([...picture, ...this.covers.map((cover) => weighted(picture, cover))]);
  }

  column(picture) {
    return this.withMeans(picture).map((value, index) => value * this.scale[index]);
  }

  /** At most `count` lights besides the environment: { sources: [{ light, own, picture }], powers, picture }. */
  solve(count, tints) {
    let best = null;
    const { kept, clusters } = this.candidates(count);
    for (const angle of DISCS) {
      const sources = this.pruned(this.sources(kept, clusters, angle, tints), count);
      const fitted = this.fitted(sources);
      if (!best || fitted.error < best.error - this.useless) best = { sources, ...fitted };
      if (!clusters.length) break;
    }
    const picture = new Float64Array(this.points.count);
    best.sources.forEach((source, index) =>
      source.picture.forEach((value, point) => (picture[point] += value * best.powers[index])),
    );
    return { sources: best.sources, powers: best.powers, picture };
  }

  /** The lights that still shine, and clusters of the directions that join them. */
  candidates(count) {
    const pictures = [...this.own.map(({ picture }) => picture), ...this.points.ofAnchors];
    const columns = pictures.map((picture) => this.column(picture));
    const worth = columns.map((column) => inner(column, this.wanted));
    const price = SPARSITY * Math.max(...worth);
    const powers = nonNegative(
      products(columns, RIDGE),
      worth.map((value, index) => value - (index < this.own.length ? 0 : price)),
    );
    const light = powers.map((value, index) => value * pictures[index].reduce((total, each) => total + each, 0));
    const least = FAINT * light.reduce((total, value) => total + value, 0);
    const kept = this.own.flatMap((source, index) => (light[index] > least ? [{ source, energy: light[index] }] : []));
    const ends = this.points.anchors.flatMap((axis, index) => {
      const energy = light[this.own.length + index];
      return energy > least ? [{ axis, energy }] : [];
    });
    return { kept, clusters: clustered(ends, count) };
  }

  /** Lights that are there: as they are, or moved to a cluster nearby; and new ones for the other clusters. */
  sources(kept, clusters, angle, tints) {
    const left = [...clusters];
    const sources = kept.map(({ source, energy }) => {
      const { light } = source;
      if (!light || isNear(light)) return { ...source, own: source };
      const axis = direction(light);
      const near = left.findIndex((cluster) => between(cluster.axis, axis) < MERGED);
      if (near < 0) return { ...source, own: source };
      const [cluster] = left.splice(near, 1);
      const middle = unit(axis.map((value, at) => value * energy + cluster.axis[at] * cluster.energy));
      const moved = { ...light, ...angles(middle) };
      return { light: moved, own: source, picture: this.points.picture(samples(moved), power(moved, tints)) };
    });
    const added = left.map(({ axis }) => {
      const light = checkedLight({ ...angles(axis), angle });
      light.name = null;
      return { light, own: null, picture: this.points.picture(samples(light)) };
    });
    return [...sources, ...added];
  }

  fitted(sources) {
    const columns = sources.map((source) => (source.column ??= this.column(source.picture)));
    const worth = columns.map((column) => inner(column, this.wanted));
    const gram = products(columns, 1e-9);
    const powers = nonNegative(gram, worth);
    let error = this.squared;
    powers.forEach((value, row) => {
      error -= 2 * value * worth[row];
      powers.forEach((other, column) => (error += value * other * gram[row][column]));
    });
    return { powers, error };
  }

  /** Leaves out the lights that are worth least, down to `count`, and all that are useless. */
  pruned(sources, count) {
    let left = sources;
    while (left.length) {
      const tried = left.map((gone) => left.filter((source) => source !== gone));
      const errors = tried.map((rest) => this.fitted(rest).error);
      const least = errors.indexOf(Math.min(...errors));
      const lamps = left.filter(({ light }) => light).length;
      if (lamps <= count && errors[least] - this.fitted(left).error > this.useless) break;
      left = tried[least];
    }
    return left;
  }
}

const inner = (one, other) => {
  let sum = 0;
  for (let index = 0; index < one.length; index++) sum += one[index] * other[index];
  return sum;
};

/** The products of columns with each other, and a share of their mean square on the diagonal. */
function products(columns, ridge) {
  const gram = columns.map(() => new Float64Array(columns.length));
  columns.forEach((column, row) => {
    for (let other = 0; other <= row; other++) gram[row][other] = gram[other][row] = inner(column, columns[other]);
  });
  const trace = gram.reduce((sum, row, index) => sum + row[index], 0);
  gram.forEach((row, index) => (row[index] += ridge * Math.max(trace / columns.length, 1e-30)));
  return gram;
}

/**
 * Non-negative least squares of normal equations, coordinate by coordinate (Franc, Hlavac and Navara 2005).
 * @param {ArrayLike<number>[]} gram
 * @param {number[]} worth
 */
export function nonNegative(gram, worth) {
  const found = worth.map(() => 0);
  const slope = Float64Array.from(worth, (value) => -value);
  for (let sweep = 0; sweep < SWEEPS; sweep++) {
    let moved = 0;
    for (let row = 0; row < found.length; row++) {
      const next = Math.max(0, found[row] - slope[row] / gram[row][row]);
      const step = next - found[row];
      if (!step) continue;
      found[row] = next;
      for (let other = 0; other < found.length; other++) slope[other] += step * gram[row][other];
      moved = Math.max(moved, step * step * gram[row][row]);
    }
    if (moved < 1e-12 * Math.max(...worth.map(Math.abs))) break;
  }
  return found;
}

/** Neighbours within MERGED are one; then the pairs that lose least, down to `count`. */
function clustered(ends, count) {
  const found = ends.map((end) => ({ ...end }));
  for (;;) {
    let best = null;
    for (let one = 1; one < found.length; one++)
      for (let other = 0; other < one; other++) {
        const [a, b] = [found[one], found[other]];
        const apart = between(a.axis, b.axis);
        const loss = ((a.energy * b.energy) / (a.energy + b.energy)) * (1 - Math.cos(apart));
        const far = apart >= MERGED;
        if (!best || far < best.far || (far === best.far && loss < best.loss)) best = { far, loss, one, other };
      }
    if (!best || (best.far && found.length <= count)) return found;
    const [gone] = found.splice(best.one, 1);
    const into = found[best.other];
    into.axis = unit(into.axis.map((value, at) => value * into.energy + gone.axis[at] * gone.energy));
    into.energy += gone.energy;
  }
}

const between = (one, other) => Math.acos(Math.min(1, Math.max(-1, dot(one, other))));

const unit = (vector) => vector.map((value) => value / Math.max(Math.hypot(...vector), 1e-12));
