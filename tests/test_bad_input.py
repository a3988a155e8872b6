"""Every wrong campaign or recording gives one clear line: where, what was found, what would be right."""

import io

import numpy as np
import polars as pl
import pytest

from inertiax.data.campaign import load_campaign
from inertiax.plausibility import require_plausible


SITE = "[site]\ngravity = 9.81\n"
FILES = '[recordings]\nfiles = ["a.csv"]\n'
GOOD = SITE + FILES


def table(columns="time,accel_x,accel_y,accel_z", row="{t:.1f},0.01,0.02,9.8{k}", count=40):
    rows = [row.format(t=0.1 * i, k=i % 3, i=i) for i in range(count)]
    return "\n".join([columns, *rows]) + "\n"


PLAIN = table()


def with_row(number, text):
    lines = PLAIN.splitlines()
    lines[number + 1] = text
    return "\n".join(lines) + "\n"


def parquet_bytes():
    memory = io.BytesIO()
    columns = {"time": np.arange(40) * 0.1}
    columns |= {f"accel_{axis}": np.full(40, 5.66) for axis in "xyz"}
    pl.DataFrame(columns).write_parquet(memory)
    return memory.getvalue()


HEADLESS = PLAIN.split("\n", 1)[1]
RATE = "time,gyro_x,gyro_y,gyro_z,reference_gyro_x,reference_gyro_y,reference_gyro_z"
THERE = "['time', 'accel_x', 'accel_y', 'accel_z']"
ACCEL = GOOD + "[columns]\naccel = "
TIME = GOOD + "[columns]\ntime = "

# campaign.toml, the recordings beside it (a.csv unless named), the message after the file's path.
TOML = {
    "empty": ("", "the file is empty; [site] and [recordings] are needed."),
    "not TOML": (
        "[site\n",
        "not valid TOML: Expected ']' at the end of a table declaration (at line 1, column 6).",
    ),
    "no site": (
        FILES,
        "[site] is missing; it gives gravity, the reference value at the test place in m/s².",
    ),
    "no recordings": (
        SITE,
        '[recordings] is missing; it names the files, for example files = ["*.csv"].',
    ),
    "no gravity": (
        "[site]\n" + FILES,
        "[site] gravity is missing; it is the reference value at the test place in m/s² "
        "(standard: 9.80665).",
    ),
    "no files": (
        SITE + "[recordings]\n",
        '[recordings] files is missing; it lists files or globs, for example files = ["*.csv"].',
    ),
    "unknown table": (
        GOOD + "[colums]\n",
        "unknown table 'colums'; did you mean 'columns'? known are site, recordings, columns, rig, "
        "device, model, table.",
    ),
    "unknown key": (
        "[site]\ngravty = 9.81\n" + FILES,
        "[site] unknown key 'gravty'; did you mean 'gravity'? known are gravity, latitude, magnetic_field.",
    ),
    "unknown inner key": (
        ACCEL + '{ units = "g" }',
        "[columns] accel: unknown key 'units'; did you mean 'unit'? known are names, unit, scale, "
        "scale_unit, offset.",
    ),
    "text for a number": (
        "[site]\ngravity = '9.81'\n" + FILES,
        "[site] gravity: expected a number; found '9.81'.",
    ),
    "number for a table": (ACCEL + "3", "[columns] accel: expected a table; found 3."),
    "text for a list": (
        SITE + '[recordings]\nfiles = "a.csv"\n',
        "[recordings] files: expected a list; found 'a.csv'.",
    ),
    "two of three names": (
        ACCEL + '{ names = ["ax", "ay"] }',
        "[columns] accel names: expected a list of three; found ['ax', 'ay'].",
    ),
    "number for yes or no": (
        GOOD + "[model]\ng_sensitivity = 1\n",
        "[model] g_sensitivity: expected true or false; found 1.",
    ),
    "broken degree": (
        GOOD + "[model]\ntemperature_degree = 2.5\n",
        "[model] temperature_degree: expected a whole number; found 2.5.",
    ),
    "negative degree": (
        GOOD + "[model]\ntemperature_degree = -2\n",
        "[model] temperature_degree = -2 must be within 0 to 12.",
    ),
    "gravity of another planet": (
        "[site]\ngravity = 98.1\n" + FILES,
        "[site] gravity = 98.1 is no gravity on Earth; it must be within 9.7 to 9.9 m/s².",
    ),
    "latitude": (
        SITE + "latitude = 123.0\n" + FILES,
        "[site] latitude = 123 must be within -90 to 90 degrees.",
    ),
    "negative uncertainty": (
        GOOD + "[rig]\nposition_uncertainty = -2.0\n",
        "[rig] position_uncertainty = -2 must be 0 or more (1 sigma).",
    ),
    "unknown grade": (
        GOOD + '[device]\ngrade = "tactial"\n',
        "[device] grade: did you mean 'tactical'? it must be one of navigation, tactical, consumer; "
        "found 'tactial'.",
    ),
    "number for an estimator": (
        GOOD + "[model]\naccel_estimator = 3\n",
        "[model] accel_estimator: expected text; found 3.",
    ),
    "estimator without its columns": (
        GOOD + '[model]\naccel_estimator = "reference"\n',
        "[model] accel_estimator = 'reference' needs the column(s) reference_accel_x/y/z, which no "
        "recording has; map them under [columns] or change accel_estimator.",
    ),
    "gyros that are not there": (
        GOOD + "[model]\ng_sensitivity = true\n",
        "[model] g_sensitivity = true needs the column(s) gyro_x/y/z, which no recording has; map "
        "them under [columns] or change g_sensitivity.",
    ),
    "degree without temperature": (
        GOOD + "[model]\ntemperature_degree = 2\n",
        "[model] temperature_degree = 2 needs the column(s) temperature, which no recording has; "
        "map them under [columns] or change temperature_degree.",
    ),
    "no file listed": (
        SITE + "[recordings]\nfiles = []\n",
        '[recordings] files is empty; list files or globs, for example ["*.csv"].',
    ),
    "file that is not there": (
        SITE + '[recordings]\nfiles = ["b.csv"]\n',
        "[recordings] files: 'b.csv' does not exist in the campaign's folder, which has ['a.csv'].",
    ),
    "glob without a match": (
        SITE + '[recordings]\nfiles = ["*.parquet"]\n',
        "[recordings] files: '*.parquet' matches no file in the campaign's folder, which has "
        "['a.csv'].",
    ),
    "glob out of the folder": (
        SITE + '[recordings]\nfiles = ["../*.csv"]\n',
        "[recordings] files: the glob '../*.csv' leaves the campaign's folder; use globs inside it, "
        "or write each outside file out in full.",
    ),
    "unknown format": (
        GOOD + 'format = "cvs"\n',
        "[recordings] format 'cvs' is not known; did you mean 'csv'? one of csv, parquet, imu_tk, "
        "euroc, imucal, hdf5, matlab, ulog, dataflash, ros is needed.",
    ),
    "start_row past the end": (
        GOOD + "start_row = 100\n",
        "a.csv: no rows of data after start_row = 100 (the file has 40); at least one sample is "
        "needed.",
    ),
    "negative start_row": (
        GOOD + "start_row = -1\n",
        "[recordings] start_row = -1 must be 0 or more rows.",
    ),
    "names for a file with a header": (
        GOOD + 'names = ["t", "accel_x", "accel_y", "accel_z"]\n',
        "a.csv: [recordings] names is for files without a header line, but this one has "
        f"{THERE} in line 1; map those under [columns].",
    ),
    "column that is not there": (
        ACCEL + '{ names = ["ax", "ay", "az"] }',
        f"a.csv: column 'ax' is missing; the file has {THERE}.",
    ),
    "same column twice": (
        ACCEL + '{ names = ["accel_x", "accel_x", "accel_z"] }',
        "[columns] accel: names must be three different columns; found "
        "['accel_x', 'accel_x', 'accel_z'].",
    ),
    "unknown unit": (
        ACCEL + '{ unit = "G" }',
        "[columns] accel: unit 'G' is not known; did you mean 'g'? use one of m/s^2, m/s2, m/s², g, "
        "mg, cm/s^2, mm/s^2.",
    ),
    "counts without scale": (
        ACCEL + '{ unit = "count" }',
        '[columns] accel: unit = "count" needs scale (and scale_unit, for example "count per '
        'm/s^2"), the nominal scale of the data sheet.',
    ),
    "scale of zero": (
        ACCEL + '{ unit = "count", scale = 0.0 }',
        "[columns] accel: scale must be finite and not zero; found [0.0, 0.0, 0.0].",
    ),
    "unknown scale unit": (
        ACCEL + '{ unit = "count", scale = 1.0, scale_unit = "LSB/g" }',
        "[columns] accel: scale_unit 'LSB/g' is not understood; write \"m/s^2 per count\" or "
        '"count per m/s^2", where the unit is one of m/s^2, m/s2, m/s², g, mg, cm/s^2, mm/s^2.',
    ),
    "scale without counts": (
        ACCEL + "{ scale = 2.0 }",
        "[columns] accel: scale belongs to raw counts, but unit is 'm/s^2'; write unit = \"count\" "
        "or leave it out.",
    ),
    "unknown time unit": (
        TIME + '{ unit = "sec" }',
        "[columns] time: unit 'sec' is not known; use one of s, ms, us, µs, ns, min, h, d, 0.1 ms.",
    ),
    "row index without rate": (
        TIME + "{ row_index = true }",
        "[columns] time: row_index = true needs rate, the samples per second.",
    ),
    "stamps and rate": (
        TIME + '{ name = "time", rate = 100.0 }',
        "[columns] time: both name = 'time' and rate are given; write name and unit to use the "
        "stamps, or rate alone to count rows.",
    ),
    "stamps of gyros that have no files": (
        TIME + '{ gyro_name = "t_g" }',
        "[columns] time: gyro_name is for gyro_files, which are not given; use name.",
    ),
    "negative rate": (
        TIME + "{ rate = -1.0 }",
        "[columns] time: rate must be a positive number of Hz; found -1.",
    ),
    "unknown temperature unit": (
        GOOD + '[columns]\ntemperature = { name = "temp", unit = "C" }',
        "[columns] temperature: unit 'C' is not known; did you mean '°C'? use one of degC, °C, K, "
        "degF, °F, count.",
    ),
}

CONTENT = {
    "empty file": ("", "a.csv: the file is empty; at least one sample is needed."),
    "header only": (
        "time,accel_x,accel_y,accel_z\n",
        "a.csv: no rows of data under the header; at least one sample is needed.",
    ),
    "comments only": ("# log\n", "a.csv: the file has no rows of data, only comments."),
    "no time": (
        PLAIN.replace("time", "t"),
        "a.csv: column 'time' is missing; the file has ['t', 'accel_x', 'accel_y', 'accel_z']. Name "
        'it with [columns] time = { name = "...", unit = "..." }, or count rows with [columns] '
        "time = { rate = ... } in Hz.",
    ),
    "one axis missing": (
        PLAIN.replace("accel_y", "Accel_Y"),
        "a.csv: column 'accel_y' is missing; did you mean 'Accel_Y'? the file has "
        "['time', 'accel_x', 'Accel_Y', 'accel_z'].",
    ),
    "no triad": (
        PLAIN.replace("accel", "acc"),
        "a.csv: neither accel_x/y/z nor gyro_x/y/z among the columns "
        "['time', 'acc_x', 'acc_y', 'acc_z']; name them under [columns] accel or gyro.",
    ),
    "text in a number": (
        with_row(5, "0.5,0.01,ERR,9.8"),
        "a.csv: column 'accel_y' holds text in row 5: 'ERR'; every row must be a number.",
    ),
    "gaps": (
        with_row(5, "0.5,0.01,,9.8").replace("1.2,0.01,0.02", "1.2,0.01,nan"),
        "a.csv: column 'accel_y' has no finite number in 2 of 40 rows, first in row 5; drop or "
        "repair them.",
    ),
    "repeated stamp": (
        with_row(5, "0.4,0.01,0.02,9.8"),
        "a.csv: time must increase strictly, but row 5 (0.400000 s) repeats the stamp of row 4 "
        "(0.400000 s); 1 repeated and 0 backward stamps in all. Add mend = true to [columns] time, or count rows with "
        "[columns] time = { rate = ... } in Hz.",
    ),
    "backward stamp": (
        with_row(5, "0.3,0.01,0.02,9.8"),
        "a.csv: time must increase strictly, but row 5 (0.300000 s) goes back from the stamp of "
        "row 4 (0.400000 s); 0 repeated and 1 backward stamps in all. Add mend = true to [columns] time, or count rows "
        "with [columns] time = { rate = ... } in Hz.",
    ),
    "cut off": (
        PLAIN[:-10],
        "a.csv: the last row has 2 of 4 fields; the file seems cut off; remove that row.",
    ),
    "a field too many": (
        with_row(5, "0.5,0.01,0.02,9.8,7"),
        "a.csv: row 5 has 5 fields but there are 4 columns.",
    ),
    "no header": (
        HEADLESS,
        "a.csv: no header line, the first line of data holds values, not names; give the 4 column names as "
        "[recordings] names = [...].",
    ),
    "name twice": (
        PLAIN.replace("accel_y", "accel_x"),
        "a.csv: column name 'accel_x' stands twice in the header "
        "['time', 'accel_x', 'accel_x', 'accel_z']; rename one of them.",
    ),
    "binary": (
        b"\0\1" * 100,
        "a.csv: the content is binary, not delimited text: byte 2 (line 1) is zero.",
    ),
    "UTF-16": (PLAIN.encode("utf-16"), "a.csv: the text is UTF-16; save it as UTF-8."),
    "broken position": (
        table("time,accel_x,accel_y,accel_z,position", "{t:.1f},0,0,9.8{k},{i}.5"),
        "a.csv: column 'position' must hold whole numbers (position); row 0 is 0.5.",
    ),
    "no serial number": (
        table("time,accel_x,accel_y,accel_z,device", "{t:.1f},0,0,9.8{k},A").replace(
            "9.80,A", "9.80,", 1
        ),
        "a.csv: column 'device' is empty in row 0; every row needs the serial number of its device.",
    ),
    "in g": (
        table(row="{t:.1f},0.01,0.02,1.0{k}"),
        "a.csv: accel has a median norm of 1.01 m/s² at rest, 0.103 times what it should be (9.81); likely "
        'unit "g". Write [columns] accel = { unit = "g" } into campaign.toml.',
    ),
    "in mg": (
        table(row="{t:.1f},10,20,100{k}"),
        "a.csv: accel has a median norm of 1001 m/s² at rest, 102 times what it should be (9.81); likely "
        'unit "mg". Write [columns] accel = { unit = "mg" } into campaign.toml.',
    ),
    "raw counts": (
        table(row="{t:.1f},32768,32768,4140{k}"),
        "a.csv: accel has a median norm of 6.214e+04 m/s² at rest, 6.33e+03 times what it should be (9.81); "
        "likely raw counts, which need scale and offset of the data sheet.",
    ),
    "gyro counts": (
        table("time,gyro_x,gyro_y,gyro_z", "{t:.1f},327,328,41{k}"),
        "a.csv: gyro has a median norm of 619.2 rad/s at rest, more than 10; likely raw counts or "
        "another unit: deg/s, deg/h, or count with scale and offset.",
    ),
    "gyro in deg/s": (
        table(RATE, "{t:.1f},0,0,57.{k},0,0,1"),
        'a.csv: gyro reads 57.1 times reference_gyro while turning; likely unit "deg/s" (or '
        'reference_gyro\'s unit is wrong). Write [columns] gyro = { unit = "deg/s" } into campaign.toml.',
    ),
}

OTHER_FILES = {
    "cut off Parquet": (
        "a.parquet",
        parquet_bytes()[:200],
        "a.parquet: the Parquet file is cut off (200 bytes, no PAR1 at the end); copy it again.",
    ),
    "CSV named Parquet": (
        "a.parquet",
        PLAIN,
        "a.parquet: not a Parquet file: it does not begin with PAR1.",
    ),
    "empty Parquet": (
        "a.parquet",
        b"",
        "a.parquet: the file is empty; at least one sample is needed.",
    ),
    "Parquet named CSV": (
        "a.csv",
        parquet_bytes(),
        "a.csv: the content is Parquet but the suffix is '.csv'; rename it to .parquet or write "
        '[recordings] format = "parquet".',
    ),
    "a spreadsheet": (
        "a.xlsx",
        b"PK\3\4\0\0",
        "a.xlsx: it is a spreadsheet; save its sheet as CSV and give that.",
    ),
    "a NumPy array": (
        "a.npy",
        b"\x93NUMPY\1\0",
        "a.npy: it is a NumPy array; write its columns as text: numpy.savetxt('log.csv', array, "
        "delimiter=',').",
    ),
    "imu_tk text with a column missing": (
        "a.mat",
        "0.0 1 2\n0.1 1 2\n",
        "a.mat: 4 column names ['time', 'x', 'y', 'z'] but 3 columns of data.",
    ),
}


def write(folder, toml, files):
    (folder / "campaign.toml").write_text(toml, "utf-8")
    for name, content in files.items():
        data = content if isinstance(content, bytes) else content.encode()
        (folder / name).write_bytes(data)
    return folder


@pytest.mark.parametrize("none", [",,", "nan,nan,nan", " , ,"])
def test_rows_of_another_sensor_are_left_out_and_counted(tmp_path, none):
    lines = PLAIN.splitlines()
    lines[6:6] = [f"0.43,{none}", f"0.46,{none}"]
    campaign = load_campaign(write(tmp_path, GOOD, {"a.csv": "\n".join(lines)}))
    (recording,) = campaign.recordings
    np.testing.assert_allclose(recording.time, 0.1 * np.arange(40), atol=1e-12)
    assert campaign.notes == ("a.csv: 2 rows without a value in any channel are left out.",)


def refusal(folder):
    with pytest.raises(ValueError) as caught:
        require_plausible(load_campaign(folder))
    message = str(caught.value)
    assert "\n" not in message
    where = f"{folder / 'campaign.toml'}: "
    assert message.startswith(where)
    return message.removeprefix(where)


@pytest.mark.parametrize("name", TOML)
def test_wrong_campaign_files_are_refused_in_one_line(tmp_path, name):
    toml, message = TOML[name]
    assert refusal(write(tmp_path, toml, {"a.csv": PLAIN})) == message


@pytest.mark.parametrize("name", CONTENT)
def test_wrong_recordings_are_refused_in_one_line(tmp_path, name):
    content, message = CONTENT[name]
    assert refusal(write(tmp_path, GOOD, {"a.csv": content})) == message


@pytest.mark.parametrize("name", OTHER_FILES)
def test_wrong_formats_are_refused_in_one_line(tmp_path, name):
    file, content, message = OTHER_FILES[name]
    assert refusal(write(tmp_path, GOOD.replace("a.csv", file), {file: content})) == message


def test_damage_inside_a_parquet_file_is_one_line(tmp_path):
    data = parquet_bytes()
    damaged = data[:4] + b"x" * 60 + data[-4:]
    message = refusal(write(tmp_path, GOOD.replace("a.csv", "a.parquet"), {"a.parquet": damaged}))
    assert message.startswith("a.parquet: the Parquet file is damaged: ")


def test_triads_in_separate_files_must_match(tmp_path):
    gyro = PLAIN.replace("accel", "gyro")
    both = GOOD + 'gyro_files = ["b.csv"]\n'
    later = gyro.splitlines()
    later = "\n".join(
        [later[0], *(f"{100 + float(x.split(',')[0])},{x.split(',', 1)[1]}" for x in later[1:])]
    )
    assert refusal(write(tmp_path, both, {"a.csv": PLAIN, "b.csv": later})) == (
        "'a.csv' and 'b.csv': the two triads were not logged at the same time (0.000 to 3.900 s and 100.000 to "
        "103.900 s); files of one log are needed, with stamps of one clock and one unit."
    )
    counted = both + "[columns]\ntime = { rate = 10.0 }\n"
    shorter = gyro.rsplit("\n", 2)[0] + "\n"
    assert refusal(write(tmp_path, counted, {"a.csv": PLAIN, "b.csv": shorter})) == (
        "'a.csv' and 'b.csv': 40 and 39 rows; files of the two triads without stamps must have the same rows."
    )
    more = GOOD + 'gyro_files = ["b.csv", "c.csv"]\n'
    files = {"a.csv": PLAIN, "b.csv": gyro, "c.csv": gyro}
    assert refusal(write(tmp_path, more, files)) == (
        "[recordings] gyro_files names 2 files but files names 1; they are paired in order, so "
        "there must be as many."
    )


def test_a_link_out_of_the_folder_is_refused_in_a_glob_and_taken_when_written_out(tmp_path):
    outside = tmp_path / "elsewhere.csv"
    outside.write_text(PLAIN)
    folder = tmp_path / "campaign"
    folder.mkdir()
    (folder / "a.csv").symlink_to(outside)
    assert refusal(write(folder, GOOD.replace("a.csv", "*.csv"), {})) == (
        "[recordings] files: 'a.csv' is a link to a file outside the campaign's folder; write its "
        "path out in full if it is meant."
    )
    assert len(load_campaign(write(folder, GOOD, {})).recordings) == 1
    assert (
        len(load_campaign(write(folder, GOOD.replace("a.csv", "../elsewhere.csv"), {})).recordings)
        == 1
    )


def test_paths_that_are_no_campaign_say_what_is_needed(tmp_path):
    with pytest.raises(ValueError, match=r"no campaign.toml in this folder; found \['a.csv'\]"):
        (tmp_path / "a.csv").write_text(PLAIN)
        load_campaign(tmp_path)
    with pytest.raises(ValueError, match="does not exist; a folder with campaign.toml"):
        load_campaign(tmp_path / "nowhere")
    with pytest.raises(
        ValueError,
        match="not a campaign.toml; `inertiax init .* -o DIR` writes one that names this recording",
    ):
        load_campaign(tmp_path / "a.csv")
