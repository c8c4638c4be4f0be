"""Generative models of joint actions by flow matching, and actors that sample from them alone."""
