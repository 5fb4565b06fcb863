"""Events and what keeps them: the schema, JSON lines, the recorder."""
