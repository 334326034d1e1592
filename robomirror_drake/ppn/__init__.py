"""The Performance Prediction Network: will this robot fall, and how well will it track?"""
