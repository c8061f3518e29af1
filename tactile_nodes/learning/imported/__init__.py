"""Data sets from images and tables of other projects, without a rig or a bag."""
