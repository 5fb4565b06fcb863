"""Reports as self-contained pages: one flight, or a fleet of them."""
