"""Which messages each autopilot sends, and how often unless told otherwise [Hz]."""

RATES = {
    # PX4's "Onboard" stream, mavlink.md section 3
    "px4": {
        "HEARTBEAT": 1.0,
        "SYS_STATUS": 5.0,
        "SYSTEM_TIME": 1.0,
        "HIGHRES_IMU": 50.0,
        "ATTITUDE": 100.0,
        "ATTITUDE_TARGET": 10.0,
        "ESC_INFO": 10.0,
        "ESC_STATUS": 10.0,
        "SERVO_OUTPUT_RAW": 10.0,
        "ACTUATOR_OUTPUT_STATUS": 0.0,
        "EXTENDED_SYS_STATE": 5.0,
        "BATTERY_STATUS": 0.5,
        "VIBRATION": 0.5,
        "TIMESYNC": 10.0,
    },
    # what a ground station usually asks ArduPilot for; unasked it sends its HEARTBEAT alone
    "ardupilot": {
        "HEARTBEAT": 1.0,
        "SYS_STATUS": 2.0,
        "SYSTEM_TIME": 1.0,
        "RAW_IMU": 50.0,
        "HIGHRES_IMU": 0.0,
        "ATTITUDE": 10.0,
        "ESC_TELEMETRY": 10.0,
        "SERVO_OUTPUT_RAW": 10.0,
        "ATTITUDE_TARGET": 0.0,
        "EXTENDED_SYS_STATE": 1.0,
        "BATTERY_STATUS": 1.0,
        "VIBRATION": 2.0,
    },
}
UNASKED = ("HEARTBEAT",)  # what ArduPilot sends before any request
# ArduPilot's groups for REQUEST_DATA_STREAM by MAV_DATA_STREAM, of the messages above; mavlink.md section 9
STREAM_GROUPS = {
    1: ("RAW_IMU",),  # RAW_SENSORS
    2: ("SYS_STATUS",),  # EXTENDED_STATUS
    3: ("SERVO_OUTPUT_RAW",),  # RC_CHANNELS
    10: ("ATTITUDE", "ESC_TELEMETRY"),  # EXTRA1
    12: ("SYSTEM_TIME", "BATTERY_STATUS", "VIBRATION"),  # EXTRA3
}
