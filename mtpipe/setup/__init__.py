"""What a laboratory says of its experiment: `setup.toml`, checked and typed."""
