"""From pictures and tables of others to a data set: no rig, no bag."""
