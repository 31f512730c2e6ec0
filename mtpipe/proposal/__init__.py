"""Looking at a laboratory's files and proposing a setup for them."""
