"""How a radar is out of true: azimuth, range and clock against ships whose way is known, and how late those told it."""
