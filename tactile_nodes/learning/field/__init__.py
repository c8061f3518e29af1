"""The force field of any contact: fitted to presses of a known body, or computed from the description of a sensor."""
