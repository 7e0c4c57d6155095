"""What is in a file of measurements: ranges of values, times, suspicious things, commands that read it."""
