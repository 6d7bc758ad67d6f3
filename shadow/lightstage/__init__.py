"""The virtual light stage: ray-traced visibility and bounce light of figures. Needs the extra `stage`."""
