"""From bags and messages of a rig to presses with their images and forces."""
