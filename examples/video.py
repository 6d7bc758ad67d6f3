"""A light that goes once around the person, as a movie.

python examples/video.py [photo] [movie] [frames]
"""

import sys
from pathlib import Path

import relight

photo = sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_name("person.png")
movie = sys.argv[2] if len(sys.argv) > 2 else "orbit.mp4"
frames = int(sys.argv[3]) if len(sys.argv) > 3 else 200

key = relight.MovingLight(orbit=frames, azimuth=-40, elevation=30, intensity=2, name="key")
fill = relight.DirectionalLight(elevation=60, intensity=0.15, angle=120, name="fill")
lighting = relight.Lighting([key, fill], background=(0.05, 0.05, 0.06))
relight.render_shot(photo, lighting, movie, frames=(1, frames))
print(f"wrote {movie}: {frames} frames")
