"""The class of subscriptions, where rclpy has it."""

from rclpy.ends import Subscription

__all__ = ['Subscription']
