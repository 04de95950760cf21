"""Pages of a result, of plans or of a cohort: pictures, sentences, numbers. May import `results` and below."""
