"""Records of the light stage, and photographs rendered from them, for training and evaluation."""
