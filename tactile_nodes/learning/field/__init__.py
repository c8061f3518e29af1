"""The force field of any contact: fitted to presses of a ball, or told by the description of a sensor."""
