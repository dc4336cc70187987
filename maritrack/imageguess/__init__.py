"""What screenshots of a radar tell of themselves: centre, rings, lines, panels, colours. Proposals for a person."""
