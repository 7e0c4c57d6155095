"""Pictures: the only room that knows matplotlib. It draws what other rooms computed."""
