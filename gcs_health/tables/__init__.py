"""Tables of facts, as TOML, each with its source in its header."""
