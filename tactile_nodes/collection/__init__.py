"""Collects labelled presses: plan, order, journal, surface search, press cycle, safety, the whole run."""
