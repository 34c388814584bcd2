"""What every room uses: errors, units, names, files, settings and processes."""
