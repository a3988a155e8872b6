"""Files of other programs, written from a made-up recording.

Libraries that not every installation has are imported where they are needed; a test that needs one skips itself.
"""

import json
import struct

import numpy as np


def matlab_73(path, arrays, struct=None):
    """As MATLAB lays v7.3 out: a text block of 512 bytes, then HDF5 with the axes reversed."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        place = file.create_group(struct) if struct else file
        file.create_group("#refs#")["a"] = np.zeros(3)
        for name, values in arrays.items():
            column = values[:, None] if values.ndim == 1 else values
            set_ = place.create_dataset(name, data=column.T)
            set_.attrs["MATLAB_class"] = np.bytes_("double")
        text = place.create_dataset("note", data=np.frombuffer(b"made up", np.uint8).astype("<u2"))
        text.attrs["MATLAB_class"] = np.bytes_("char")
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: today HDF5 schema 1.00 ."
    with path.open("r+b") as file:
        file.write(head.ljust(124) + b"\0\2IM")


FIELDS = "uint64_t timestamp;uint64_t timestamp_sample;uint32_t device_id;float x;float y;float z;"
FORMATS = {
    "sensor_accel": FIELDS + "float temperature;",
    "sensor_gyro": FIELDS + "float temperature;",
    "sensor_combined": "uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;",
    "sensor_mag": FIELDS + "float temperature;",
    "sensor_baro": "uint64_t timestamp;float pressure;",
    "battery_status": "uint64_t timestamp;float current_a;",
}


def ulog_message(kind, payload):
    return struct.pack("<HB", len(payload), ord(kind)) + payload


def ulog(path, streams, *, parameters=None, release=None):
    """`streams`: (topic, instance, rows of values in the format's order); `parameters` by name."""
    data = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1_000_000)
    data += ulog_message("B", bytes(40))
    if release is not None:
        key = b"uint32_t ver_sw_release"
        data += ulog_message("I", bytes([len(key)]) + key + struct.pack("<I", release))
    for name, value in (parameters or {}).items():
        kind, form = ("int32_t", "<i") if isinstance(value, int) else ("float", "<f")
        key = f"{kind} {name}".encode()
        data += ulog_message("P", bytes([len(key)]) + key + struct.pack(form, value))
    for topic in dict.fromkeys(topic for topic, _, _ in streams):
        data += ulog_message("F", f"{topic}:{FORMATS[topic]}".encode())
    for number, (topic, instance, _) in enumerate(streams):
        data += ulog_message("A", struct.pack("<BH", instance, number) + topic.encode())
    layouts = {"sensor_combined": "<Q6f", "sensor_baro": "<Qf", "battery_status": "<Qf"}
    for number, (topic, _, rows) in enumerate(streams):
        layout = layouts.get(topic, "<QQI4f")
        for row in rows:
            data += ulog_message("D", struct.pack("<H", number) + struct.pack(layout, *row))
    path.write_bytes(data)


def sensor_rows(data, key, *, delay=0.0, temperature=True):
    stamps = (1e6 * (data["time"] + delay)).round().astype(int)
    probe = data["temperature"] if temperature else np.full(len(stamps), np.nan)
    return [
        (t + 300, t, 1310988, *map(float, v), float(p))
        for t, v, p in zip(stamps.tolist(), data[key], probe, strict=True)
    ]


def raw_log(path, data, instances=(0,)):
    ulog(
        path,
        [
            (f"sensor_{key}", i, sensor_rows(data, key))
            for i in instances
            for key in ("accel", "gyro")
        ],
    )


HEAD = b"\xa3\x95"
COLUMNS = ("TimeUS", "I", "GyrX", "GyrY", "GyrZ", "AccX", "AccY", "AccZ", "T")


def dataflash_format(number, name, layout, columns):
    """A FMT message: type, length, name[4], format[16], columns[64]."""
    sizes = {"Q": 8, "I": 4, "B": 1, "f": 4, "N": 16}
    length = 3 + sum(sizes[c] for c in layout.decode())
    body = struct.pack("<BB4s16s64s", number, length, name, layout, ",".join(columns).encode())
    return HEAD + b"\x80" + body


def dataflash(path, data, instances=(0,), columns=COLUMNS, others=()):
    """`others`: (name, columns, rows) of further messages; whole numbers are stamps or, as `I`, a sensor's."""
    layout = "".join({"TimeUS": "Q", "TimeMS": "I", "I": "B"}.get(c, "f") for c in columns)
    content = (
        HEAD
        + b"\x80"
        + struct.pack("<BB4s16s64s", 0x80, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
    )
    content += dataflash_format(0x81, b"IMU", layout.encode(), columns)
    stamps = (1e6 * data["time"]).round().astype(int).tolist()
    for k, stamp in enumerate(stamps):
        for i in instances:
            row = dict(zip(COLUMNS[2:8], [*data["gyro"][k], *data["accel"][k]], strict=True))
            row |= {"TimeUS": stamp, "TimeMS": stamp // 1000, "I": i, "T": data["temperature"][k]}
            content += HEAD + b"\x81" + struct.pack("<" + layout, *(row[c] for c in columns))
    for number, (name, fields, rows) in enumerate(others, start=0x82):
        form = "".join({"TimeUS": "Q", "I": "B", "Name": "N"}.get(c, "f") for c in fields)
        content += dataflash_format(number, name.encode(), form.encode(), fields)
        packed = "<" + form.replace("N", "16s")
        for row in rows:
            content += HEAD + bytes([number]) + struct.pack(packed, *row)
    path.write_bytes(content)


IMU, TEMPERATURE = "sensor_msgs/msg/Imu", "sensor_msgs/msg/Temperature"
RECEIVED = 15_000_000_000  # ns, when the first message arrived: 5 s after its own stamp


def header(types, kind, stamp):
    time = types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
    more = {"seq": 0} if kind == "ros1" else {}
    return types["std_msgs/msg/Header"](stamp=time, frame_id="imu", **more)


def imu_message(types, kind, stamp, accel, gyro, absent=()):
    vector, quaternion = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Quaternion"]
    none, known = np.array([-1.0] + 8 * [0.0]), np.zeros(9)
    return types[IMU](
        header=header(types, kind, stamp),
        orientation=quaternion(0.0, 0.0, 0.0, 1.0),
        orientation_covariance=none,
        angular_velocity=vector(*gyro),
        angular_velocity_covariance=none if "gyro" in absent else known,
        linear_acceleration=vector(*accel),
        linear_acceleration_covariance=none if "accel" in absent else known,
    )


def bag(path, kind, data, *, topics=("/imu0",), probe=True, stamped=True, absent=()):
    """A bag with one IMU topic or several and a probe at a tenth of the rate."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin, Writer as Writer2
    from rosbags.typesys import get_typestore, Stores

    store = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE)
    types = store.types
    serialize = store.serialize_ros1 if kind == "ros1" else store.serialize_cdr
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    writer = Writer1(path) if kind == "ros1" else Writer2(path, version=9, storage_plugin=plugin)
    stamps = (1e9 * data["time"]).round().astype(int).tolist()
    with writer:
        connections = [writer.add_connection(t, IMU, typestore=store) for t in topics]
        heat = writer.add_connection("/probe", TEMPERATURE, typestore=store) if probe else None
        for k, stamp in enumerate(stamps):
            own = stamp if stamped else 0
            message = imu_message(types, kind, own, data["accel"][k], data["gyro"][k], absent)
            received = RECEIVED + k * 5_000_000
            for c in connections:
                writer.write(c, received, serialize(message, IMU))
            if heat is not None and (k % 10 == 0 or k == len(stamps) - 1):
                t = types[TEMPERATURE](header(types, kind, stamp), data["temperature"][k], 0.0)
                writer.write(heat, received, serialize(t, TEMPERATURE))


EUROC = (
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n"
)


def euroc(folder, data):
    folder.mkdir(parents=True)
    stamps = 1403636579000000000 + (1e9 * data["time"]).round().astype(int)
    rows = zip(stamps.tolist(), data["gyro"].tolist(), data["accel"].tolist(), strict=True)
    text = "".join(",".join(map(repr, (t, *w, *a))) + "\n" for t, w, a in rows)
    (folder / "data.csv").write_text(EUROC + text)
    (folder / "sensor.yaml").write_text("sensor_type: imu\n")


RATE = 100.0
SECTIONS = ("x_p", "x_a", "y_p", "y_a", "z_p", "z_a", "x_rot", "y_rot", "z_rot")
ACCEL = np.eye(3) + [[0.01, 0.004, -0.003], [0.002, -0.02, 0.005], [-0.006, 0.001, 0.015]]
GYRO = np.eye(3) + [[0.02, 0.003, -0.004], [-0.001, -0.01, 0.006], [0.005, 0.002, 0.03]]
BIAS_A, BIAS_G = np.array([0.3, -0.2, 0.1]), np.array([0.6, -0.4, 0.1])  # m/s², deg/s
D = np.array([[4, -5, 0], [4, 5, 6], [1, -1, 2]]) * 1e-3  # deg/s per m/s²


def session(folder, *, noise=0.0, angle=-360.0):
    """A session with known truth: rests, and turns that start, hurry and stop."""
    rng = np.random.default_rng(1)
    rows, sections = [], {}
    for name in SECTIONS:
        axis = np.eye(3)["xyz".index(name[0])]
        count = 300
        force = 9.81 * (-axis if name.endswith("_a") else axis)
        t = np.arange(count) / count
        rate = np.zeros(count)
        if name.endswith("_rot"):
            profile = np.sin(np.pi * t) ** 2 * (1 + 0.3 * np.sin(6 * np.pi * t))
            rate = angle * RATE * profile / profile.sum()
        gyro = np.outer(rate, GYRO @ axis) + BIAS_G + D @ force
        accel = np.tile(ACCEL @ force + BIAS_A, (count, 1))
        sections[name] = {"start": len(rows) + 20, "end": len(rows) + 20 + count}
        rows += [[0.0] * 3 + [9.0] * 3] * 20  # between sections: of no use
        both = np.hstack([gyro, accel])
        rows += (both + noise * rng.standard_normal(both.shape)).tolist()
    names = ["gyr_x", "gyr_y", "gyr_z", "acc_x", "acc_y", "acc_z"]
    lines = ["n_samples," + ",".join(names)]
    lines += [f"{k}," + ",".join(map(repr, row)) for k, row in enumerate(rows)]
    (folder / "a.csv").write_text("\n".join(lines) + "\n")
    (folder / "a_list.json").write_text(json.dumps(sections))
