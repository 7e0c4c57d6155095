"""The page of `report`: what is drawn and listed of each file, and the HTML around it."""
