"""Kernels of the cloth solver: extended position-based dynamics (XPBD) on triangles, compiled by numba.

A frame consists of small steps with one sweep over the constraints each (Macklin et al. 2016, "XPBD"; 2019,
"Small Steps in Physics Simulation"). Sweeps are sequential and in a fixed order: threads would make the
result random, and alternating directions make the cloth vibrate. Positions are (V, 3) float32 in metres, y
up.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

GRAVITY = 9.81  # m/s²
MAX_SPEED = 3.0  # m/s, so that collisions do not eject cloth


class Cloth(NamedTuple):
    """The constants of one simulated garment. Compliances are divided by the square of the time step."""

    inverse_mass: np.ndarray  # (V,) inverse mass, 1/kg
    edges: np.ndarray  # (E, 2)
    length: np.ndarray  # (E,) at rest, metres
    tension: np.float32  # compliance of a stretched edge
    compression: np.float32  # compliance of a compressed edge
    hinges: np.ndarray  # (H, 4): the two ends of an inner edge, the two vertices opposite it
    stencil: np.ndarray  # (H, 4): their weights in the bending vector
    bending: np.ndarray  # (H,) compliance of a hinge
    pull: np.ndarray  # (V,) share of the distance to its target that a vertex moves in each step
    tether: np.ndarray  # (V,) the nearest held vertex along the cloth, or itself
    tether_length: np.ndarray  # (V,) metres of cloth to that vertex
    rest: np.ndarray  # (V, 3) in the pattern: vertices that are close there do not repel each other
    friction: np.float32  # Coulomb coefficient against the obstacle
    thickness: np.float32  # metres between cloth and cloth


class Planes(NamedTuple):
    """The tangent plane of the obstacle near each vertex of the cloth."""

    near: np.ndarray  # (V,) the nearest vertex of the obstacle, or -1 if there is none
    bits: np.ndarray  # (V,) uint16 kinds of contact: only obstacle vertices with a common bit count
    point: np.ndarray  # (V, 3)
    normal: np.ndarray  # (V, 3)
    motion: np.ndarray  # (V, 3) of the obstacle, metres in each step
    gap: np.float32  # metres between cloth and obstacle
    deepest: np.float32  # metres inside, beyond which there is no collision


class Obstacle(NamedTuple):
    """A surface whose vertices move in straight lines during a frame."""

    start: np.ndarray  # (P, 3) at the start of the frame
    end: np.ndarray  # (P, 3) at its end
    normals: np.ndarray  # (P, 3) at its end
    first: np.ndarray  # (P + 1,) where the neighbours of each vertex begin in `ring`
    ring: np.ndarray
    allowed: np.ndarray  # (P,) uint16 kinds of contact, as bits
    reach: np.ndarray  # (P,) m² over which planes are blended: 0.3 of the mean squared edge length there


compiled = njit(cache=True, fastmath=True, error_model="numpy")


@compiled
def advance(x, before, motion, step, damping):
    """Integrate velocity and gravity, and add `motion` (V, 3), in metres for each step."""
    fall = GRAVITY * step * step
    limit = (MAX_SPEED * step) ** 2
    for i in range(len(x)):
        vx, vy, vz = x[i, 0] - before[i, 0], x[i, 1] - before[i, 1], x[i, 2] - before[i, 2]
        speed = vx * vx + vy * vy + vz * vz
        keep = damping
        if speed > limit:
            keep *= np.sqrt(limit / speed)
        for k in range(3):
            x[i, k] += motion[i, k]
            before[i, k] = x[i, k]
        x[i, 0] += keep * vx
        x[i, 1] += keep * vy - fall
        x[i, 2] += keep * vz


@compiled
def stretch(x, cloth):
    """Project the distance constraints of the edges."""
    inverse_mass, length = cloth.inverse_mass, cloth.length
    for e in range(len(length)):
        i, j = cloth.edges[e, 0], cloth.edges[e, 1]
        dx, dy, dz = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
        now = np.sqrt(dx * dx + dy * dy + dz * dz) + np.float32(1e-9)
        gap = now - length[e]
        compliance = cloth.tension if gap > 0 else cloth.compression
        share = gap / ((inverse_mass[i] + inverse_mass[j] + compliance) * now)
        a, b = inverse_mass[i] * share, inverse_mass[j] * share
        x[i, 0] += a * dx
        x[i, 1] += a * dy
        x[i, 2] += a * dz
        x[j, 0] -= b * dx
        x[j, 1] -= b * dy
        x[j, 2] -= b * dz


@compiled
def bend(x, cloth):
    """Project the constraints of quadratic isometric bending with a flat rest shape (Bergou et al. 2006)."""
    inverse_mass = cloth.inverse_mass
    for h in range(len(cloth.hinges)):
        a, b, c, d = cloth.hinges[h, 0], cloth.hinges[h, 1], cloth.hinges[h, 2], cloth.hinges[h, 3]
        ka, kb, kc, kd = cloth.stencil[h, 0], cloth.stencil[h, 1], cloth.stencil[h, 2], cloth.stencil[h, 3]
        wa, wb, wc, wd = (
            inverse_mass[a] * ka,
            inverse_mass[b] * kb,
            inverse_mass[c] * kc,
            inverse_mass[d] * kd,
        )
        share = np.float32(-1) / (wa * ka + wb * kb + wc * kc + wd * kd + cloth.bending[h])
        for k in range(3):
            pull = share * (ka * x[a, k] + kb * x[b, k] + kc * x[c, k] + kd * x[d, k])
            x[a, k] += wa * pull
            x[b, k] += wb * pull
            x[c, k] += wc * pull
            x[d, k] += wd * pull


@compiled
def hold(x, cloth, start, end, late):
    """Pull held and anchored vertices toward their targets, which move from `start` to `end`."""
    early = np.float32(1) - late
    for i in range(len(x)):
        pull = cloth.pull[i]
        if pull > 0:
            for k in range(3):
                x[i, k] += pull * (early * start[i, k] + late * end[i, k] - x[i, k])


@compiled
def tie(x, cloth):
    """Project long range attachments (Kim et al. 2012): limit the distance of each vertex to its tether."""
    for i in range(len(x)):
        a = cloth.tether[i]
        if a == i:
            continue
        dx, dy, dz = x[i, 0] - x[a, 0], x[i, 1] - x[a, 1], x[i, 2] - x[a, 2]
        square = dx * dx + dy * dy + dz * dz
        if square > cloth.tether_length[i] * cloth.tether_length[i]:
            share = cloth.tether_length[i] / np.sqrt(square) - np.float32(1)
            x[i, 0] += share * dx
            x[i, 1] += share * dy
            x[i, 2] += share * dz


@compiled
def part(x, before, pairs, thickness):
    """Resolve self-collisions: move pairs of vertices `thickness` apart, without adding velocity."""
    least = thickness * thickness
    for p in range(len(pairs)):
        i, j = pairs[p, 0], pairs[p, 1]
        dx, dy, dz = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
        square = dx * dx + dy * dy + dz * dz
        if square < least:
            now = np.sqrt(square) + np.float32(1e-7)
            share = np.float32(0.5) * (thickness - now) / now
            dx, dy, dz = share * dx, share * dy, share * dz
            x[i, 0] -= dx
            x[i, 1] -= dy
            x[i, 2] -= dz
            x[j, 0] += dx
            x[j, 1] += dy
            x[j, 2] += dz
            before[i, 0] -= dx
            before[i, 1] -= dy
            before[i, 2] -= dz
            before[j, 0] += dx
            before[j, 1] += dy
            before[j, 2] += dz


@compiled
def collide(x, before, planes, motion, friction, since):
    """Push vertices that are closer to the obstacle than the gap out of it, with Coulomb friction.

    The velocity along the normal becomes zero. The planes are `since` steps old.
    """
    for i in range(len(x)):
        if planes.near[i] < 0:
            continue
        nx, ny, nz = planes.normal[i, 0], planes.normal[i, 1], planes.normal[i, 2]
        mx, my, mz = planes.motion[i, 0], planes.motion[i, 1], planes.motion[i, 2]
        depth = planes.gap - (
            (x[i, 0] - planes.point[i, 0] - since * mx) * nx
            + (x[i, 1] - planes.point[i, 1] - since * my) * ny
            + (x[i, 2] - planes.point[i, 2] - since * mz) * nz
        )
        if depth <= 0 or depth > planes.deepest:
            continue
        x[i, 0] += depth * nx
        x[i, 1] += depth * ny
        x[i, 2] += depth * nz
        # The motion of the cloth relative to the obstacle in this step.
        sx = x[i, 0] - before[i, 0] + motion[i, 0] - mx
        sy = x[i, 1] - before[i, 1] + motion[i, 1] - my
        sz = x[i, 2] - before[i, 2] + motion[i, 2] - mz
        along = sx * nx + sy * ny + sz * nz
        sx, sy, sz = sx - along * nx, sy - along * ny, sz - along * nz
        slide = np.sqrt(sx * sx + sy * sy + sz * sz) + np.float32(1e-12)
        stop = min(np.float32(1), friction * depth / slide)
        x[i, 0] -= stop * sx
        x[i, 1] -= stop * sy
        x[i, 2] -= stop * sz
        before[i, 0] += along * nx
        before[i, 1] += along * ny
        before[i, 2] += along * nz


@compiled
def _walk(here, near, obstacle, late, bits):
    """Find the obstacle's vertex nearest to a point by a walk over neighbours, from a vertex close to it."""
    start, end = obstacle.start, obstacle.end
    early = np.float32(1) - late
    best = np.float32(0)
    for k in range(3):
        best += (early * start[near, k] + late * end[near, k] - here[k]) ** 2
    for _ in range(8):
        closer = near
        for r in range(obstacle.first[near], obstacle.first[near + 1]):
            j = obstacle.ring[r]
            if obstacle.allowed[j] & bits == 0:
                continue
            square = np.float32(0)
            for k in range(3):
                square += (early * start[j, k] + late * end[j, k] - here[k]) ** 2
            if square < best:
                best, closer = square, j
        if closer == near:
            break
        near = closer
    return near


@compiled
def follow(x, planes, obstacle, time, steps):
    """Track the obstacle vertex nearest to each vertex, and blend the tangent planes of its neighbours.

    time: within the frame, in [0, 1]. steps: number of steps in the frame.
    """
    start, end, first = obstacle.start, obstacle.end, obstacle.first
    late = np.float32(time)
    early = np.float32(1) - late
    point, normal, motion = np.empty(3, np.float32), np.empty(3, np.float32), np.empty(3, np.float32)
    for i in range(len(x)):
        if planes.near[i] < 0:
            continue
        near = _walk(x[i], planes.near[i], obstacle, late, planes.bits[i])
        planes.near[i] = near
        reach = obstacle.reach[near]
        total, flat = np.float32(0), np.float32(0)
        point[:], normal[:], motion[:] = 0, 0, 0
        for r in range(first[near] - 1, first[near + 1]):
            j = near if r < first[near] else obstacle.ring[r]
            out, square = np.float32(0), np.float32(0)
            for k in range(3):
                gap = x[i, k] - early * start[j, k] - late * end[j, k]
                out += gap * obstacle.normals[j, k]
                square += gap * gap
            share = reach / (reach + max(square - out * out, np.float32(0)))
            share = share * share * share
            total += share
            flat += share * out
            for k in range(3):
                point[k] += share * (early * start[j, k] + late * end[j, k])
                normal[k] += share * obstacle.normals[j, k]
                motion[k] += share * (end[j, k] - start[j, k])
        length = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2) + np.float32(1e-9)
        chord = np.float32(0)
        for k in range(3):
            chord += (x[i, k] - point[k] / total) * normal[k] / length
        # On a convex surface, the plane through the mean point is inside, and the mean of the planes is
        # outside by the same distance. The surface is halfway between them.
        lift = np.float32(0.5) * (chord - flat / total) / length
        for k in range(3):
            planes.point[i, k] = point[k] / total + lift * normal[k]
            planes.normal[i, k] = normal[k] / length
            planes.motion[i, k] = motion[k] / (total * steps)


@compiled
def close_pairs(x, rest, reach, apart):
    """Return pairs of vertices (N, 2) that are closer than `reach`, and farther than `apart` at rest."""
    count = len(x)
    size = 1
    while size < 2 * count:
        size *= 2
    cell = np.empty((count, 3), np.int32)
    slot = np.empty(count, np.int32)
    begins = np.zeros(size + 1, np.int32)
    for i in range(count):
        for k in range(3):
            cell[i, k] = np.int32(np.floor(x[i, k] / reach))
        slot[i] = (cell[i, 0] * 73856093 ^ cell[i, 1] * 19349663 ^ cell[i, 2] * 83492791) & (size - 1)
        begins[slot[i] + 1] += 1
    for s in range(size):
        begins[s + 1] += begins[s]
    order = np.empty(count, np.int32)
    filled = begins[:-1].copy()
    for i in range(count):
        order[filled[slot[i]]] = i
        filled[slot[i]] += 1
    pairs = np.empty((8 * count, 2), np.int32)
    total = 0
    for i in range(count):
        for step in range(18):  # its own cell, and one of each two opposite cells of the 26 around it
            a, b, c = step // 9, (step // 3) % 3 - 1, step % 3 - 1
            if a == 0 and (b < 0 or (b == 0 and c < 0)):
                continue
            u, v, w = cell[i, 0] + a, cell[i, 1] + b, cell[i, 2] + c
            s = (u * 73856093 ^ v * 19349663 ^ w * 83492791) & (size - 1)
            for index in range(begins[s], begins[s + 1]):
                j = order[index]
                if cell[j, 0] != u or cell[j, 1] != v or cell[j, 2] != w:
                    continue
                if a == 0 and b == 0 and c == 0 and j <= i:
                    continue
                now, then = np.float32(0), np.float32(0)
                for k in range(3):
                    now += (x[i, k] - x[j, k]) ** 2
                    then += (rest[i, k] - rest[j, k]) ** 2
                if now < reach * reach and then > apart * apart and total < len(pairs):
                    pairs[total, 0], pairs[total, 1] = i, j
                    total += 1
    return pairs[:total]


@compiled
def frame(x, before, cloth, obstacle, own, other, start, end, motion, steps, step, damping):
    """Advance the cloth by one frame of `steps` steps of `step` seconds, in place.

    before (V, 3): positions one step ago. own, other: Planes of the obstacle under the cloth, and of other
    obstacles, which have the lower priority. start, end (V, 3): the targets of held vertices. motion (V, 3):
    metres by which the cloth is moved in each step. damping: share of the velocity that remains after a step.
    """
    pairs = np.empty((0, 2), np.int32)
    for s in range(steps):
        advance(x, before, motion, step, damping)
        hold(x, cloth, start, end, np.float32((s + 1) / steps))
        stretch(x, cloth)
        bend(x, cloth)
        tie(x, cloth)
        if s == 0:
            pairs = close_pairs(
                x, cloth.rest, np.float32(2) * cloth.thickness, np.float32(2.5) * cloth.thickness
            )
        part(x, before, pairs, cloth.thickness)
        since = s % 8
        if since == 0:
            follow(x, own, obstacle, (s + 1) / steps, steps)
            follow(x, other, obstacle, (s + 1) / steps, steps)
        collide(x, before, other, motion, cloth.friction, np.float32(since))
        collide(x, before, own, motion, cloth.friction, np.float32(since))
