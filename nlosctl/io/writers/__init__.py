"""Tables to files: encoders, atomic files, all-or-nothing outputs."""
