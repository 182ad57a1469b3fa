"""What is said to people instead of a traceback."""


class UserError(Exception):
    """Something from outside cannot be used: a file, a folder, data, what is asked of a flight.

    The message says what is wrong, where and what would be right; the command line prints it and ends with
    exit code 2. Every exception of the package whose message is for people extends this one.
    """
