"""From an untouched gel to labelled indentations: plan, order, journal, surface, press cycle, safety, the whole run."""
