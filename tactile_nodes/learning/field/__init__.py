"""The force field of any contact: fitted to presses of a known body, or told by the description of a sensor."""
