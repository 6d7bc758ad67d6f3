// Where a picture lies on its stage, and how wheels and fingers change that.
//
// A view is { scale, left, top, fitted }: CSS pixels a pixel of the picture, where its corner is, and the scale at
// which all of it is seen.

/** The view that shows all of a picture of `size` on a stage, both [width, height], with a margin around it. */
export function fitting([width, height], size, margin) {
  const scale = Math.min((width - 2 * margin) / size[0], (height - 2 * margin) / size[1]);
  return { scale, left: (width - size[0] * scale) / 2, top: (height - size[1] * scale) / 2, fitted: scale };
}

/** A view whose scale is multiplied, within `limits` of the fitted one, and whose spot `from` comes to lie at `to`. */
export function zoomed(view, times, from, to, limits) {
  const [low, high] = limits.map((limit) => limit * view.fitted);
  const scale = Math.min(Math.max(view.scale * times, low), high);
  const by = scale / view.scale;
  return { ...view, scale, left: to[0] - (from[0] - view.left) * by, top: to[1] - (from[1] - view.top) * by };
}

/**
 * A view moved and zoomed by fingers, or one pointer: `began` and `now` are their spots, `view` the one they began
 * with.
 */
export function panned(view, began, now, limits) {
  const middle = (spots) => [0, 1].map((axis) => spots.reduce((sum, spot) => sum + spot[axis], 0) / spots.length);
  const spread = (spots) =>
    spots.length < 2 ? 1 : Math.hypot(spots[0][0] - spots[1][0], spots[0][1] - spots[1][1]) || 1;
  return zoomed(
    view,
    now.length === began.length ? spread(now) / spread(began) : 1,
    middle(began),
    middle(now),
    limits,
  );
}

/** How much a turn of the wheel zooms. */
export const wheeled = (event) => Math.exp(-event.deltaY * (event.deltaMode === 1 ? 0.03 : 0.0015));
