"""Which code page a text is in that is no UTF-8: the one in which stations' programs of its language write.

A file says nothing of it, but its bytes do. In the two-byte pages a letter is a lead and a trail byte, and words are
runs of such pairs; in Western text letters beyond ASCII stand alone between ASCII ones (`Prüfling`), and in Cyrillic
text they are words of single bytes. The pages: JIS X 0208 in Shift_JIS as Windows has it (cp932), KS X 1001 (cp949),
GB 18030, Windows-1251 and Windows-1252. Where none of the first four fits, it is the last one.
"""

import re


_ENOUGH = 1 << 16  # bytes that are looked at: names, units and settings stand at the top
# Two characters side by side of signs, kana and the kanji of daily use: quotes and dashes in Western text.
_JAPANESE = re.compile(rb"(?:[\x81-\x83\x88-\x98][\x40-\x7e\x80-\xfc]){2}")
_RUN = re.compile(rb"[\x80-\xff]+")
_PAIRS = re.compile(rb"(?:[\xa1-\xfe]{2})+")
_SIGNS = range(0xA1, 0xAA)  # lead bytes of ℃ and its like, in Korean and Chinese
_HANGUL = range(0xB0, 0xC9)  # lead bytes of the syllables
_HANZI = range(0xB0, 0xD8)  # lead bytes of the characters of daily use
_CYRILLIC = re.compile(rb"[\xa8\xb8\xc0-\xff]{4}")


def code_page(text: bytes) -> str:
    """The name, as Python has it, of the code page of a text: `utf-8` where it is UTF-8.

    **Example:**

    >>> code_page("角速度X[deg/s],温度[℃]".encode("cp932")), code_page("Prüfling,25 °C".encode("cp1252"))
    ('cp932', 'cp1252')
    """
    top = text[:_ENOUGH]
    if len(text) > _ENOUGH:
        top = top[: top.rfind(b"\n") + 1] or top  # no letter cut in two
    if top.isascii() or _decodes(top, "utf-8"):
        return "utf-8"
    if _JAPANESE.search(top) and _decodes(top, "cp932"):
        return "cp932"
    runs = _RUN.findall(top)
    if any(len(r) >= 4 for r in runs) and all(_PAIRS.fullmatch(r) for r in runs):
        leads = {lead for r in runs for lead in r[::2]} - set(_SIGNS)
        for page, usual in (("cp949", _HANGUL), ("gb18030", _HANZI)):
            if leads <= set(usual) and _decodes(top, page):
                return page
    return "cp1251" if _CYRILLIC.search(top) else "cp1252"


def _decodes(text: bytes, page: str) -> bool:
    try:
        text.decode(page)
    except UnicodeDecodeError:
        return False
    return True
