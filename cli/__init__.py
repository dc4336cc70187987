"""The command line of maritrack. Thin: a command parses, calls one function of the library, renders."""
