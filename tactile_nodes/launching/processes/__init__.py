"""The processes of a launch: starting, watching, reading output, ending."""
