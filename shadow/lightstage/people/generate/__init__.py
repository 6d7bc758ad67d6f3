"""Random people from seeds: bodies, poses, outfits, and pairs who hold each other."""
