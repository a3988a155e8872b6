"""Words by which columns are called, by language: one table of roles.

Words are regular expressions on a name in lower case without accents (`plain`); of a triad it is the first column's
name without its unit. "any" holds abbreviations, and names that data sheets and loggers use in all languages. Words
that English has, too (acceleration, gyroscope, temperature, position), are in its line alone.
"""

import re
import unicodedata
from typing import Literal


Role = Literal[
    "accel", "gyro", "mag", "other", "no_mag", "no_gravity", "reference", "rate", "time", "counter",
    "temperature", "position", "experiment", "device",
]  # fmt: skip

_NUMBER = r"s?(?:[_ .-]*(?:id|no|nr|num|numb?er|nummer|numero|index|#))?[_ .-]*$"

WORDS: dict[Role, dict[str, str]] = {
    "accel": {
        "any": r"^a[_ .-]?x|^x?a$|^f[_ .-]?x|^gfx|a_rs_s",
        "en": r"acc|force",
        "de": r"beschl|spez\w*[_ .-]*kraft",
        "es": r"acel",  # and Portuguese
    },
    "gyro": {
        "any": r"^w[_ .-]?x|^g[_ .-]?x|w_rs_s|ω|^p$",
        "en": r"gyr|^rotate_|ang\w*[_ .-]?(?:vel|rate)|omega|rot\w*rate|(?:roll|pitch|yaw)[_ .-]*(?:rate|speed)",
        "de": r"dreh(?!m|w|z)|winkelgeschw|winkelrate|kreisel|(?:roll|wank|nick|gier)\w*?(?:rate|geschw)",
        "fr": r"(?:vit\w*|taux)[_ .-]*(?:de[_ .-]*)?(?:ang|rot|roulis|tangage|lacet)",
        "es": r"giro|vel\w*[_ .-]*(?:de[_ .-]*)?(?:ang|rot|alabeo|balanceo|cabeceo|guinada)",
        "it": r"vel\w*[_ .-]*(?:di[_ .-]*)?(?:rollio|beccheggio|imbardata)",
    },
    "mag": {
        "any": r"^m[_ .-]?x$|^b[_ .-]?x$",
        "en": r"mag|compass",
        "de": r"kompass",
        "fr": r"boussole|champ",
        "es": r"brujula|campo",
        "it": r"bussola",
    },
    "other": {  # triads that are no outputs of an IMU's sensors
        "any": r"mag|^m[_ .-]?x|^b[_ .-]?x|euler|quat|pos|cov|bias|ref|(?<![a-z])(?:std|stdev|sigma|var)(?![a-z])",
        "en": r"orient|free_?acc|user_?acc|linear acc|^gravity|ang\w*[_ .-]?acc|compass",
        "de": r"lineare?[_ .-]?beschl|winkelbeschl|^schwerkraft|kompass|(?<![a-z])lage|soll",
        "fr": r"acc\w*[_ .-]*(?:lin|ang)|^gravite|boussole|champ|consigne",
        "es": r"acel\w*[_ .-]*(?:lin|ang)|^gravedad|brujula|campo|consigna",
        "it": r"^gravita|bussola|riferimento",
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
        "any": r"^tmp|°c|^t_?c$",
        "en": r"temp(?!s(?![a-z])|o(?![a-z])|oral|el)|^t_(?:imu|probe|sens|die|board|chip|case|degc)",
        "de": r"^t_(?:geh|platine|fuhler|fuehler|sonde)",
        "fr": r"^t_(?:capteur|boitier|carte)",
        "es": r"^t_(?:caja|placa|sonda)",
        "it": r"^t_(?:scheda|scatola)",
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
    ("ns", r"nano|[\[(_ .]ns\b|ns$"),
    ("us", r"mi[ck]ro|[\[(_ .](?:us|µs)\b|us$|µs$|sampletimefine"),
    ("ms", r"milli|milis|[\[(_ .]ms\b|ms$"),
    ("s", r"se[ck][ou]nd|segund|\(s\)|\[s\]|_s$|\bs$|sec$|sek$"),
)
_DEGREE = r"(?:deg(?:re+s?)?|°|grad[ois]*)"
RATE_UNITS = (
    ("deg/h", rf"{_DEGREE}[ _]?(?:/|per|pro)[ _]?(?:h|std)|dph"),
    ("deg/s", rf"{_DEGREE}|dps"),
    (
        "rad/s",
        r"rad|(?:^|[ ./])angular_velocity\.[xyz]\b",
    ),  # the latter: a field of ROS's sensor_msgs/Imu
)
FORCE_UNITS = (
    ("mg", r"milli_?g(?![a-z])|[\[(_ .]mg(?![a-z])"),
    ("mm/s^2", r"\bmm ?/ ?s|mm_?s2\b"),
    ("cm/s^2", r"\bcm ?/ ?s|cm_?s2\b|\bgal\b"),
    ("m/s^2", r"m ?/ ?s(?:\^|\*\*)?(?:2|²|\b)|m ?s\^?-2|mps2|m_?s2\b|linear_acceleration\.[xyz]\b"),
    ("g", r"[\[(_ .]gs?(?:[\])]|$|(?= ))"),
)
UNIT = re.compile(
    r"[\[(].*|[_ .](?:m|mg|deg|mdeg|rad|°|grad|grados|gradi|degres)/(?:s|h).*", re.IGNORECASE
)

_COMPILED = {role: re.compile("|".join(words.values())) for role, words in WORDS.items()}


def plain(name: str) -> str:
    """A name in lower case without accents: "Längs" and "längs" are "langs", "Température" is "temperature"."""
    parts = unicodedata.normalize("NFD", name)
    return "".join(c for c in parts if not unicodedata.combining(c)).lower()


def means(role: Role, name: str) -> bool:
    """Whether a name has a word of that role, in any language."""
    return _COMPILED[role].search(plain(name)) is not None


def without(role: Role, name: str) -> str:
    """A name in lower case without the first word of that role."""
    return _COMPILED[role].sub("", plain(name), count=1).strip("_ .-")


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
