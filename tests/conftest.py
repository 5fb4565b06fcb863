"""Puts this folder on the path, for the helpers that several kinds of tests share."""
