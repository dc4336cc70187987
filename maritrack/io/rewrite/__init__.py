"""A CAT240 recording written anew: a part of it, its cells compressed or not, the rest octet for octet."""
