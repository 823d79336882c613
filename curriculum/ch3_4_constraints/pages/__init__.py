"""The two pages that a reader touches, and what keeps texts equal to what runs."""
