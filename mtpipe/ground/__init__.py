"""What every room stands on: errors, notices, files, processes."""
