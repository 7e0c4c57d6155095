"""What the columns of some files imply: three dimensions, and arrival times."""
