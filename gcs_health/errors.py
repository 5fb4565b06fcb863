"""The one exception family: what the user gave us that we cannot work with.

GcsHealthError
├── ConfigError      an option or a configuration file
├── AirframeError    a vehicle file, or a geometry that no estimator can use
├── DialectError     a MAVLink dialect that lacks a message we need
├── LogError         a file that holds no MAVLink
└── EndpointError    a link that cannot be opened

Each message is one line that names the file, key or endpoint and says what would be right;
`gcs_health.cli` prints it and exits with 2. Bytes from the air never raise: they are counted.
"""


class GcsHealthError(Exception):
    """Base of all errors that are the input's, not ours."""


class ConfigError(GcsHealthError):
    """An option or a configuration file cannot be used."""


class AirframeError(GcsHealthError):
    """A vehicle file or a geometry cannot be used."""


class DialectError(GcsHealthError):
    """A MAVLink dialect lacks a message that is needed."""


class LogError(GcsHealthError):
    """A file cannot be read as a MAVLink log."""


class EndpointError(GcsHealthError):
    """A link cannot be opened."""
