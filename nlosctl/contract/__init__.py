"""All that a method needs to know, and all that a plugin imports."""
