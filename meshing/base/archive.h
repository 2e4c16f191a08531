// Values as bytes and back on one machine.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstring>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "meshing/base/namespace.h"

namespace testbed::meshing {

/// Writes values or reads them, in the same order. Of a type of one's own, a function archive(Archive&, Type&) beside it
/// names the members.
class Archive {
 public:
  Archive() = default;                                                           ///< writes
  explicit Archive(std::string_view bytes) : read_(bytes), is_reading_(true) {}  ///< reads what outlives it

  /// @throws std::runtime_error where there are fewer bytes to read than the values take
  template <class... Values>
  void operator()(Values&... values) {
    (visit(values), ...);
  }
  const std::string& bytes() const& { return bytes_; }
  std::string bytes() && { return std::move(bytes_); }
  bool is_reading() const { return is_reading_; }
  std::string_view rest() const { return read_; }  ///< left to read

 private:
  void copy(void* value, std::size_t n) {
    if (n == 0) return;  // an empty list may have no address, which memcpy does not allow
    if (!is_reading_) {
      bytes_.append(static_cast<const char*>(value), n);
      return;
    }
    expect(n);
    std::memcpy(value, read_.data(), n);
    read_.remove_prefix(n);
  }

  void expect(std::size_t n) const {
    if (is_reading_ && n > read_.size())
      throw std::runtime_error(std::to_string(read_.size()) + " bytes, expected " + std::to_string(n));
  }

  /// Of a list whose entries take a byte at least.
  template <class List>
  std::size_t count(const List& list) {
    auto n = static_cast<std::size_t>(list.size());
    copy(&n, sizeof n);
    expect(n);
    return n;
  }

  template <class Value>
  void visit(Value& value) {
    if constexpr (std::is_arithmetic_v<Value> || std::is_enum_v<Value>)
      copy(&value, sizeof value);
    else
      archive(*this, value);
  }
  void visit(std::string& text) {
    text.resize(count(text));
    copy(text.data(), text.size());
  }
  template <class Scalar, int rows, int columns>
  void visit(Eigen::Matrix<Scalar, rows, columns>& values) {
    Eigen::Index n = values.rows(), m = values.cols();
    (*this)(n, m);
    expect(static_cast<std::size_t>(n * m) * sizeof(Scalar));
    values.resize(n, m);
    copy(values.data(), static_cast<std::size_t>(n * m) * sizeof(Scalar));
  }
  template <class First, class Second>
  void visit(std::pair<First, Second>& both) {
    (*this)(both.first, both.second);
  }
  template <class Value, std::size_t n>
  void visit(std::array<Value, n>& values) {
    for (Value& value : values) visit(value);
  }
  template <class Value>
  void visit(std::vector<Value>& values) {
    const std::size_t n = count(values);
    if constexpr (std::is_arithmetic_v<Value>) {
      expect(n * sizeof(Value));
      values.resize(n);
      copy(values.data(), n * sizeof(Value));
    } else {
      values.resize(n);
      for (Value& value : values) visit(value);
    }
  }
  template <class Value>
  void visit(std::optional<Value>& value) {
    bool is_there = value.has_value();
    visit(is_there);
    if (is_reading_) value.reset();
    if (is_reading_ && is_there) value.emplace();
    if (is_there) visit(*value);
  }
  template <class Value>
  void visit(std::unique_ptr<Value>& value) {
    bool is_there = value != nullptr;
    visit(is_there);
    if (is_reading_) value = is_there ? std::make_unique<Value>() : nullptr;
    if (is_there) visit(*value);
  }
  template <class Value>
  void visit(std::shared_ptr<const Value>& value) {
    bool is_there = value != nullptr;
    visit(is_there);
    if (is_reading_) value.reset();
    if (!is_there) return;
    auto copied = is_reading_ ? std::make_shared<Value>() : std::make_shared<Value>(*value);
    visit(*copied);
    if (is_reading_) value = std::move(copied);
  }

  std::string bytes_;      ///< written
  std::string_view read_;  ///< the rest
  bool is_reading_ = false;
};

}  // namespace testbed::meshing
