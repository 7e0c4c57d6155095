"""Steps between a reader and the contract: wide columns, missing values, conditions on rows, declination."""
