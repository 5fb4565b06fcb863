"""Wire knowledge, and nowhere else: framing, dialect, meaning, logs, links."""
