"""Pictures: the only part of the package that uses matplotlib; other parts compute what it draws."""
