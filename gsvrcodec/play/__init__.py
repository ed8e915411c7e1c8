"""The player for browsers: a server of films and pages, and pages that hold a film."""
