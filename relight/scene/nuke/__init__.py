"""Nuke scripts: a picture out of its light groups, and a group of nodes that lights a person."""

from relight.scene.nuke.light_groups import check_layers, is_script, write_script
