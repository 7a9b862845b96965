// An object of the core with a memory, that several of Python's threads may hold: one call at a time.
#pragma once

#include <pybind11/pybind11.h>

#include <memory>
#include <mutex>
#include <utility>

namespace ocisac::bindings {

template <class T>
class Shared {
 public:
  explicit Shared(T object) : held_(std::make_unique<Held>(std::move(object))) {}

  // body(T&), without the interpreter's lock; calls of other threads wait.
  template <class Body>
  auto call(Body body) {
    const pybind11::gil_scoped_release unlocked;
    const std::scoped_lock alone(held_->busy);
    return body(held_->object);
  }

 private:
  struct Held {
    explicit Held(T&& given) : object(std::move(given)) {}
    T object;
    std::mutex busy;
  };
  std::unique_ptr<Held> held_;  // pybind11 moves what a factory returns
};

}  // namespace ocisac::bindings
