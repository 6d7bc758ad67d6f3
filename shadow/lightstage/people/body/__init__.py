"""The body: shape, face, skeleton and skinning."""
