"""Read and write recordings and tables in common file formats, and audit what was read."""
