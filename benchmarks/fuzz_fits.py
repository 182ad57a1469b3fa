"""FITS pictures whose cards say something else, for `fuzz`."""

CARD, BLOCK = 80, 2880
ODD = (
    "0", "-1", "1", "2", "3", "7", "999", "1000000000", "-64", "1e300", "-1e300", "1e400", "nan", "inf",
    "T", "F", "'text'", "''", "", "(1, 2)", "1_0", "0x10", "'2012-02-30'", "1.5", "12 34", "'1_0'", "1D5",
)  # fmt: skip
KEYS = (
    "SIMPLE", "BITPIX", "NAXIS", "NAXIS1", "NAXIS2", "NAXIS3", "BSCALE", "BZERO", "BLANK", "EXPTIME",
    "VELX", "DATE-OBS", "VELY", "VELZ", "PCOUNT", "GCOUNT", "GROUPS", "XTENSION", "ZIMAGE", "EXTEND", "END",
    "CONTINUE", "INHERIT", "CHECKSUM", "DATASUM",
)  # fmt: skip
TOLD = {
    "EXPTIME": "0.5",
    "DATE-OBS": "'2012-06-22'",
    "VELX": "1.0",
    "VELY": "2.0",
    "VELZ": "3.0",
    "BZERO": "0",
}


def with_cards(content):
    """A FITS file that also says when and how it was taken."""
    cards, rest = _parts(content)
    return _joined([*cards, *(_card(key, value) for key, value in TOLD.items())], rest)


def spoilt(rng, content):
    """Bytes of a FITS file with one to three changes in the cards of its first head."""
    cards, rest = _parts(content)
    for _ in range(1 + rng.integers(3)):
        at, way = int(rng.integers(1, len(cards))), rng.integers(7)
        if way <= 1:
            cards[at] = _card(cards[at][:8].decode("latin-1"), ODD[rng.integers(len(ODD))])
        elif way == 2:
            cards.insert(at, _card(KEYS[rng.integers(len(KEYS))], ODD[rng.integers(len(ODD))]))
        elif way == 3:
            cards.insert(at, cards[rng.integers(len(cards))])
        elif way == 4:
            del cards[at]
        elif way == 5:
            cards[at] = bytes(rng.integers(0, 256, CARD, dtype="u1"))
        else:
            key = KEYS[rng.integers(len(KEYS))]
            found = [k for k, card in enumerate(cards) if card[:8].decode(errors="replace").strip() == key]
            card = _card(key, ODD[rng.integers(len(ODD))])
            cards[found[0] if found else at] = card
        if len(cards) < 2:
            break
    return _joined(cards, rest)


def _parts(content):
    """Cards of the first head, without END, and what follows it."""
    end = next(k for k in range(0, len(content), CARD) if content[k : k + 8] == b"END     ")
    cards = [content[k : k + CARD] for k in range(0, end, CARD)]
    return cards, content[-(-(end + CARD) // BLOCK) * BLOCK :]


def _joined(cards, rest):
    head = b"".join(cards) + b"END".ljust(CARD)
    return head.ljust(-(-len(head) // BLOCK) * BLOCK) + rest


def _card(key, value):
    return f"{key:<8}= {value:>20}".encode("latin-1").ljust(CARD)[:CARD]
