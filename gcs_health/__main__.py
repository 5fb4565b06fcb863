"""`python -m gcs_health`."""

from gcs_health.cli import main

if __name__ == "__main__":
    raise SystemExit(main())
