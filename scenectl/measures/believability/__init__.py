"""Would a person move like that? What each check found, and the sentence that says it."""
