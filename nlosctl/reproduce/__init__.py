"""Tables and figures of the four papers, one room per paper, and the Monte-Carlo loop that runs them."""
