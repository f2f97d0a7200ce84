"""Open shots kept in step with their scenes: what the artist changes becomes a request, new pictures become redraws."""
