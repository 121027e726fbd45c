"""What a token may be: the coordinator and whoever asks it read theirs by one rule."""


def usable(token: str) -> str:
    """Return a token as requests bear it, without what is blank around it.

    A secret that was made of a file ends as the file does, with the end of a line.

    Raises:
        ValueError: no request can bear it; the sentence says what could be, and shows nothing.
    """
    token = token.strip()
    # Bytes that are no UTF-8 come from the environment as what is not ASCII, either.
    if not token.isascii() or not token.isprintable() or " " in token:
        raise ValueError(
            "the token holds a blank, a control character or a letter that is not ASCII, which no "
            "request can bear: take letters, digits and punctuation, as `openssl rand -hex 24` "
            "prints"
        )
    return token
