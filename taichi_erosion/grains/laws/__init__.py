"""Contact slots: one file per law; a run compiles in exactly one law for every slot."""
