"""Training: recipes, stages, and the loop under them. Nothing else imports it."""
