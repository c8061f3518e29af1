"""What a person types: one file a verb, each thin over what it calls."""
