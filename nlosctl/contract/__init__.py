"""The interface of methods: everything that a plugin imports."""
