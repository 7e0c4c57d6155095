"""Tables and figures of the five papers, one room per paper, and the Monte-Carlo loop that runs them."""
