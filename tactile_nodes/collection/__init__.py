"""From an untouched gel to labelled presses: plan, order, journal, surface, press cycle, safety, the whole run."""
