"""The order of the folders of `relight`."""

FOLDERS = (  # from the top to the bottom: each imports only from those below it
    "cli",
    "comfyui",
    "app",
    "distributed",
    "viewer",
    "pipeline",
    "scene",
    "light_estimation",
    "light_painting",
    "rendering",
    "subject",
    "analysis",
    "compositing",
    "matting",
    "lights",
    "media",
    "version",
    "quantities",
    "arguments",
)
