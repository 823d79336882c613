"""The chapter as a page, its figures and pictures: no run needs them."""
