"""The arm: bones, muscles, soft tissue and activation."""
