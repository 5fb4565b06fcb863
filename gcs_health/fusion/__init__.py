"""From estimates to what the operator is told."""
