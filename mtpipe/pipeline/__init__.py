"""A whole run: from files to a folder of results."""
