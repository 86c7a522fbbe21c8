"""Which numbers fixed in the code decide answers: each is changed, and answers asked again."""
