"""Options: their declarations, where their values come from, completion."""
