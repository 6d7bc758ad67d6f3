"""The page in which one holds the light, for the bundled person: open it in a browser, and drag.

python examples/viewer.py [person.png] [file.html]
"""

import sys
from pathlib import Path

import relight

person = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("person.png")
path = Path(sys.argv[2]) if len(sys.argv) > 2 else Path("person.html")

lights = [
    relight.DirectionalLight(
        azimuth=-40, elevation=30, intensity=1.2, temperature=4500, angle=12, name="key"
    ),
    relight.DirectionalLight(azimuth=140, elevation=20, intensity=1.5, colour=(0.5, 0.7, 1), name="rim"),
]
subject = relight.Subject(relight.read(person))
subject.view(
    path,
    lights,
    background=(0.02, 0.022, 0.027),
    title=person.name,
    command=["relight", "apply", str(person)],
)
print(f"wrote {path}")
