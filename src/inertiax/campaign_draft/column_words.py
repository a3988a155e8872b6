"""Words by which columns are called, by language: one table of roles.

Words are regular expressions on a name in lower case without accents (`plain`); of a triad it is the first column's
name as `column_triads.called` makes it. "any" holds abbreviations, and names that data sheets and loggers use in all
languages. Words that English has, too (acceleration, gyroscope, temperature, position), are in its line alone.
"""

import re
import unicodedata
from typing import Literal


Role = Literal[
    "accel", "gyro", "mag", "other", "no_mag", "no_gravity", "reference", "rate", "time", "counter",
    "temperature", "surroundings", "position", "experiment", "device",
]  # fmt: skip

# A field's letter before the unit that stands behind its axis: mx_mG, mx_G, Bx_uT. "b" and "h" in mg or g are a body's
# force.
_FIELD = r"^[mbh]_(?:[unmµμ]t|m?gauss)_x$|^m_m?g_x$"
_NUMBER = r"s?(?:[_ .-]*(?:id|no|nr|num|numb?er|nummer|numero|index|#))?[_ .-]*$"

WORDS: dict[Role, dict[str, str]] = {
    "accel": {
        "any": r"^a[_ .-]?x(?!is)|^x?a$|^f[_ .-]?x|^gfx|a_rs_s",
        "en": r"acc|force|delta[_ .-]?v(?:el)?",
        "de": r"beschl|spez\w*[_ .-]*kraft",
        "es": r"acel",  # and Portuguese
        "ru": r"ускор",
        "zh": r"加速",  # and Japanese
        "ko": r"가속",
    },
    "gyro": {
        "any": r"^w[_ .-]?x|^g[_ .-]?x|w_rs_s|ω|^p$|(?<![a-z])avel",
        "en": r"gyr|^rotate_|delta[_ .-]?(?:theta|ang)|ang\w*[_ .-]?(?:vel|rate)|omega|rot\w*rate|"
        r"(?:roll|pitch|yaw)[_ .-]*(?:rate|speed)",
        "de": r"dreh(?!m|w|z)|winkelgeschw|winkelrate|kreisel|(?:roll|wank|nick|gier)\w*?(?:rate|geschw)",
        "fr": r"(?:vit\w*|taux)[_ .-]*(?:de[_ .-]*)?(?:ang|rot|roulis|tangage|lacet)",
        "es": r"giro|vel\w*[_ .-]*(?:de[_ .-]*)?(?:ang|rot|alabeo|balanceo|cabeceo|guinada)",
        "it": r"vel\w*[_ .-]*(?:di[_ .-]*)?(?:rollio|beccheggio|imbardata)",
        "ru": r"углов\w*[_ .-]*скор|гиро",
        "zh": r"角速|陀螺|シャイロ",
        "ko": r"각속|자이로",
    },
    "mag": {
        "any": rf"^[mbh][_ .-]?x$|^mf_x$|{_FIELD}",
        "en": r"mag|compass",
        "de": r"kompass",
        "fr": r"boussole|champ",
        "es": r"brujula|campo",
        "it": r"bussola",
        "ru": r"магн",
        "zh": r"磁",
        "ko": r"자기",
    },
    "other": {  # triads that are no outputs of an IMU's sensors
        "any": r"mag|^[mb][_ .-]?x|^(?:h|mf)_x$|euler|quat|pos|cov|bias|ref|(?<![a-z])(?:std|stdev|sigma|var)(?![a-z])|"
        + _FIELD,
        "en": r"orient|free_?acc|user_?acc|linear acc|^gravity|ang\w*[_ .-]?acc|compass",
        "de": r"lineare?[_ .-]?beschl|winkelbeschl|^schwerkraft|kompass|(?<![a-z])lage|soll",
        "fr": r"acc\w*[_ .-]*(?:lin|ang)|^gravite|boussole|champ|consigne",
        "es": r"acel\w*[_ .-]*(?:lin|ang)|^gravedad|brujula|campo|consigna",
        "it": r"^gravita|bussola|riferimento",
        "ru": r"магн|(?:углов|линеи)\w*[_ .-]*ускор",
        "zh": r"磁|角加速|線形加速|线性加速|角度|姿态|重力",
        "ko": r"자기|각가속|선형",
    },
    "no_mag": {"any": r"cov|bias|ref|cal"},
    "no_gravity": {
        "en": r"linear.?acc|user.?acc|free.?acc|without g",
        "de": r"linear\w*.?beschl|ohne g",
        "fr": r"acc\w*.?lin|sans g",
        "es": r"acel\w*.?lin|sin g",
        "it": r"acc\w*.?lin|senza g",
    },
    "reference": {
        "en": r"ref(?:erence)?|truth|true|ideal|setpoint|set|command|cmd|table|nominal",
        "de": r"referenz|soll(?:wert)?|tisch|vorgabe|wahr",
        "fr": r"consigne|commande|vraie?",
        "es": r"referencia|consigna|mesa|verdad\w*",
        "it": r"riferimento|tavola|comand\w*",
    },
    "rate": {"any": r"^r[_ .-]?x", "en": r"rate", "de": r"geschw", "fr": r"vit", "es": r"vel"},
    "time": {
        "any": r"^t$|^t[_ (\[]|^ts|utc",
        "en": r"time|stamp|second|^sec|^millis|^micros|^clock|^now(?![a-z])",
        "de": r"zeit(?!konst)|stempel|sekund|uhr$|^uhr",
        "fr": r"temps(?![a-z])|horodat|^heure",
        "es": r"tiempo|segund|^hora(?![a-z])",
        "it": r"tempo(?![a-z])|^ora(?![a-z])|^orario",
        "ru": r"врем",
        "zh": r"时间|時間|时刻|時刻",
        "ko": r"시간|시각",
    },
    "counter": {  # of packets or rows, some of which are others' or are missing
        "any": r"^(?:n|no|nr|idx|id|#)$|index|seq",
        "en": r"packet|count|sample(?!time)|frame|(?:row|line)[_ .-]*n",
        "de": r"paket|zahler|zaehler|zeile",
        "fr": r"paquet|compteur|echantillon|ligne",
        "es": r"paquete|contador|muestra|amostra|fila",
        "it": r"pacchetto|contatore|campion|riga",
    },
    "temperature": {
        "any": r"^tmp|[°º˚']c\b|[\[(] ?(?:[01][.,/][01]+ ?\*? ?|[cdm](?=deg))?(?:deg)?c(?:elsius)?[\])]"
        r"|^t_?c$|^t ?\(°\)|(?<![a-z])deg_?c(?:els(?:ius)?)?$|(?<![a-z])celsius(?![a-z])",
        "en": r"temp(?!s(?![a-z])|o(?![a-z])|oral|el)|^t_(?:imu|probe|sens|die|board|chip|case|degc)",
        "de": r"^t_(?:geh|platine|fuhler|fuehler|sonde)",
        "fr": r"^t_(?:capteur|boitier|carte)",
        "es": r"^t_(?:caja|placa|sonda)",
        "it": r"^t_(?:scheda|scatola)",
        "ru": r"темпер",
        "zh": r"温度|溫度",
        "ko": r"온도",
    },
    "surroundings": {  # of a temperature: of what is around the device, or commanded
        "any": r"klima|climat|ambi[ea]nt|therm\w*_?stat",
        "en": r"chamber|oven|(?<![a-z])(?:air|room|lab|bath|set(?:_?point)?|target|outside)(?![a-z])",
        "de": r"kammer|ofen(?![a-z])|umgeb|(?<![a-z])(?:luft|raum|labor|soll)",
        "fr": r"enceinte|etuve|consigne|(?<![a-z])(?:salle|four)(?![a-z])",
        "es": r"camara|horno|consigna|(?<![a-z])sala(?![a-z])",
        "it": r"camera|forno|stanza",
        "ru": r"камер|окруж|воздух|печ",
    },
    "position": {
        "en": rf"^(?:position|pose){_NUMBER}",
        "de": rf"^(?:mess)?(?:lage|stellung|position|pos){_NUMBER}",
        "es": rf"^posicion{_NUMBER}",
        "it": rf"^(?:posizione|posa){_NUMBER}",
    },
    "experiment": {
        "en": rf"^(?:experiment|run){_NUMBER}",
        "de": rf"^(?:versuch|messlauf|lauf|messreihe){_NUMBER}",
        "fr": rf"^(?:essai|experience){_NUMBER}",
        "es": rf"^(?:ensayo|experimento){_NUMBER}",
        "it": rf"^(?:prova|esperimento){_NUMBER}",
    },
    "device": {
        "any": r"^s[_ ./-]?n(?:[_ .-]?r)?$",
        "en": rf"^(?:device|dut|serial|unit_?id){_NUMBER}",
        "de": rf"^(?:gerate?|geraet|prufling|pruefling|serien){_NUMBER}",
        "fr": r"^(?:appareil|(?:numero|no|n°)[_ .-]*(?:d[ei][_ .-]*)?serie)$",
        "es": r"^(?:dispositivo|equipo)$",
        "it": r"^(?:dispositivo|matricola)$",
    },
}

# Words of a file's name, for a triad whose columns have none: sensors, and chips that hold nothing else.
FILES: dict[Role, re.Pattern[str]] = {
    "accel": re.compile(r"acc|beschl|adxl"),
    "gyro": re.compile(r"gyr|l3g|itg"),
    "mag": re.compile(r"mag(?!ic)|compass|kompass|[hq]mc\d|lis3mdl|ak8|ak09"),
}

# Axes by words, in the order x (forward), y (across), z (vertical).
AXES_IN_WORDS = (
    ("p", "q", "r"),  # rates, as aeronautics writes them
    ("roll", "pitch", "yaw"), ("longitudinal", "lateral", "vertical"),
    ("roll", "nick", "gier"), ("wank", "nick", "gier"),
    ("langs", "quer", "hoch"), ("langs", "quer", "vertikal"),
    ("laengs", "quer", "hoch"), ("laengs", "quer", "vertikal"),
    ("roulis", "tangage", "lacet"), ("longitudinale", "laterale", "verticale"),
    ("alabeo", "cabeceo", "guinada"), ("balanceo", "cabeceo", "guinada"),
    ("rollio", "beccheggio", "imbardata"),
)  # fmt: skip

# Units of time and rate as files write them, the longer words first.
TIME_UNITS = (
    ("ns", r"nano|(?<![a-z])nsec|[\[(_ .]ns\b|ns$"),
    ("us", r"mi[ck]ro|usec|[\[(_ .](?:us|µs)\b|us$|µs$|sampletimefine"),
    ("ms", r"milli|milis|msec|[\[(_ .]ms\b|ms$"),
    ("s", r"se[ck][ou]nd|segund|\(s\)|\[s\]|_s$|\bs$|sec$|sek$"),
)
# Units of a station's clock, and of a spreadsheet's.
LONG_TIME_UNITS = (
    ("min", r"minut|[\[(_ .]mins?(?:[\])]|$)"),
    ("h", r"hour|stunde|[\[(]hr?s?[\])]|_hrs?$"),
    ("d", r"(?<![a-z])days?(?![a-z])|datenum|[\[(]d[\])]"),
)
_DEGREE = r"(?:deg(?:re+s?)?|°|grad[ois]*)"
RATE_UNITS = (
    ("deg/h", rf"{_DEGREE}[ _]?(?:/|per|pro)[ _]?(?:h|std)|dph|deg_?h(?:r|our)?(?![a-z])"),
    ("deg/s", rf"{_DEGREE}|dps|\bd/s"),
    (
        "rad/s",
        r"rad|(?:^|[ ./])angular_velocity[./][xyz]\b",
    ),  # the latter: a field of ROS's sensor_msgs/Imu
)
FORCE_UNITS = (
    ("mg", r"milli_?g(?![a-z])|[\[(_ .]mg(?![a-z])"),
    ("mm/s^2", r"\bmm ?/ ?s|mm_?s2\b"),
    ("cm/s^2", r"\bcm ?/ ?s|cm_?s2\b|\bgal\b"),
    (
        "m/s^2",
        r"m ?/ ?\(?s(?:\^|\*\*)?(?:2|²|\b)|m ?s\^?-2|mps2|m_?s2\b|linear_acceleration[./][xyz]\b",
    ),
    ("g", r"[\[(_ .]gs?(?:[\])]|$|(?= ))"),
)
UNIT = re.compile(
    r"[\[(][^\[\]()]*(?:\([^()]*\)[^\[\]()]*)?(?:[\])]|$)"
    r"|[_ .](?:m|mg|deg|mdeg|rad|°|grad|grados|gradi|degres)/(?:s|h).*"
    r"|[_ .](?:m?dps|(?:m?deg|rad)(?:ps|_?(?:per_?)?s(?:ec)?))$",  # p_degs, wx_rad_s
    re.IGNORECASE,
)

# What a triad is called by one letter or two, behind words that say whose it is: imu_a_x, raw_w_x. No "la": that is a
# linear acceleration with gravity for some and without it for others, as its norm says.
SYMBOLS: dict[str, Literal["accel", "gyro"]] = {
    "a": "accel", "f": "accel", "sf": "accel", "gf": "accel", "xl": "accel",
    "w": "gyro", "ω": "gyro", "om": "gyro", "av": "gyro", "g": "gyro", "gy": "gyro",
    # In axes of the body, of it against inertial space: NaveGo, and texts on navigation.
    "fb": "accel", "fib": "accel", "fbib": "accel", "wb": "gyro", "wib": "gyro", "wbib": "gyro",
}  # fmt: skip
_OWNER = re.compile(r"imu|sens|raw|body|dut|dev|mpu|icm|bmi|lsm|[a-z]?\d")
_BETWEEN_WORDS = re.compile(r"[^a-z0-9ω]+")
# A rate in words that no angle has.
_RATE = re.compile(rf"(?:{_DEGREE}|rad\w*|\bd) ?(?:/|_?per_?|pro) ?s|dps(?![a-z])|rads(?![a-z])")

_COMPILED = {role: re.compile("|".join(words.values())) for role, words in WORDS.items()}


def plain(name: str) -> str:
    """A name in lower case without accents: "Längs" and "längs" are "langs", "Température" is "temperature"."""
    parts = unicodedata.normalize("NFD", name)
    kept = "".join(c for c in parts if not unicodedata.combining(c))
    return unicodedata.normalize("NFC", kept).lower()


def means(role: Role, name: str) -> bool:
    """Whether a name has a word of that role, in any language."""
    return _COMPILED[role].search(plain(name)) is not None


def without(role: Role, name: str) -> str:
    """A name in lower case without the first word of that role."""
    return _COMPILED[role].sub("", plain(name), count=1).strip("_ .-")


def symbol(name: str) -> Literal["accel", "gyro"] | None:
    """What a triad is whose name, as `column_triads.called` makes it, is a symbol: `av_x` is the gyros.

    M1, M2, M3 are motors, and A0, A1, A2 inputs of a converter: symbols have x, y, z.
    """
    if not name.endswith("_x"):
        return None
    words = [w for w in _BETWEEN_WORDS.split(plain(name)) if not _OWNER.match(w)]
    # Of gFx, g-force, a capital begins a second word: its two letters are one symbol, which says more than the first.
    pair = "".join(words[:2]) if len(words) > 2 and len(words[0]) == len(words[1]) == 1 else ""
    return SYMBOLS.get(pair) or SYMBOLS.get(words[0] if words else "")


def behind_owner(name: str) -> str:
    """What stands behind the names of a struct and of a device: `a_x` of lowg_data.a_x and of kx_imu_a_x; the name
    itself where neither is there."""
    field = name.rsplit(".", 1)[-1]
    words = _BETWEEN_WORDS.split(field)
    owners = [k for k, word in enumerate(words[:-1]) if _OWNER.match(word)]
    return "_".join(words[owners[-1] + 1 :]) if owners else field


def is_a_rate(hint: str) -> bool:
    """Whether words of a file name a unit of rates that is none of angles."""
    return _RATE.search(plain(hint)) is not None


def without_unit(name: str) -> str:
    """A name without what stands in brackets, or behind it as a unit."""
    return UNIT.sub("", name).strip()


def said(units: tuple[tuple[str, str], ...], hint: str) -> str | None:
    """The first unit of `TIME_UNITS` or `RATE_UNITS` that words of a file name; `None` where they name none."""
    return next((u for u, words in units if re.search(words, plain(hint))), None)


def triad_of_words(name: str, names: dict[str, str]) -> tuple[str, str, str] | None:
    """The three columns that differ in a word for their axis alone, where `name` is that of x.

    **Arguments:** `names` are all columns, by their names in `plain`.
    """
    own = plain(name)
    for axes in AXES_IN_WORDS:
        if axes[0] not in own or (len(axes[0]) == 1 and without_unit(own) != axes[0]):
            continue
        x, y, z = (names.get(own.replace(axes[0], a, 1)) for a in axes)
        if x is None or y is None or z is None:
            continue
        if means("gyro", without_unit(own)) or means("accel", own):
            return x, y, z
    return None
